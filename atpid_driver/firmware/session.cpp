// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "session.h"

#include <string.h>

#include "table.h"

namespace {

bool is(const Request &request, const char *word) { return strcmp(request.word, word) == 0; }

const char *reason(Answer answer) {
    switch (answer) {
        case Answer::OK: return nullptr;
        case Answer::DISARMED: return "DISARMED";
        case Answer::UNHOMED: return "UNHOMED";
        case Answer::BUSY: return "BUSY";
        case Answer::RANGE: return "RANGE";
        case Answer::FAULT: break;
    }
    return "FAULT";
}

}  // namespace

void Session::answer(const Request &request, uint16_t rejected, FrameWriter &reply) {
    reply.number(request.sequence);
    const bool identify = is(request, "ID") && !request.has_number;
    const char *refused = identify ? nullptr : refuse(request);
    if (identify) {  // a new host: whatever the last one began ends here
        motion_.disarm();
        open_ = true;
        last_ = request.sequence;
        return write_identity(reply);
    }
    if (refused) {
        reply.text(",NO,");
        return reply.text(refused);
    }
    write_state(rejected, reply);
}

// Returns why the request was not carried out, or nullptr.
const char *Session::refuse(const Request &request) {
    if (!open_) return "SESSION";
    const int16_t ahead = static_cast<int16_t>(request.sequence - last_);
    if (ahead < 0) return "OLD";
    if (ahead == 0) return nullptr;  // repeated: its answer was lost, its effect is there
    const char *refused = act(request);
    last_ = request.sequence;
    return refused;
}

const char *Session::act(const Request &request) {
    if (is(request, "LOOKUP")) return look_up(request);
    const bool moves = is(request, "MOVE");
    if (request.has_number != moves) return "ARGUMENT";
    if (is(request, "STATE")) return nullptr;
    if (is(request, "STOP")) return reason(motion_.stop());
    if (is(request, "DISARM")) {
        motion_.disarm();
        return nullptr;
    }
    const char *const words[] = {"BEAT", "ARM", "HOME", "MOVE"};
    bool known = false;
    for (const char *word : words) known = known || is(request, word);
    if (!known) return "COMMAND";
    motion_.beat();  // only a command that moves counts as heartbeat
    if (moves) return reason(motion_.move(static_cast<int32_t>(request.number)));
    if (is(request, "ARM")) return reason(motion_.arm());
    if (is(request, "HOME")) return reason(motion_.home());
    return nullptr;
}

const char *Session::look_up(const Request &request) {
    int32_t height_um = 0;
    if (!request.has_number) return "ARGUMENT";
    if (!table_size()) return "TABLE";
    if (!table_height(request.number, height_um)) return "RANGE";
    motion_.beat();
    return reason(motion_.move(height_um));
}

void Session::write_identity(FrameWriter &reply) const {
    reply.text(",ID,ATPID-MOTOR," FIRMWARE_VERSION ",");
    reply.number(PROTOCOL_VERSION);
    reply.comma();
    reply.number(board_.boots);
    reply.comma();
    reply.text(board_.reset_cause);
    const int32_t figures[] = {LOWEST_UM, HIGHEST_UM, SPEED_UM_PER_S};
    for (const int32_t figure : figures) {
        reply.comma();
        reply.number(static_cast<uint32_t>(figure));
    }
    reply.comma();
    reply.number(table_size());
}

void Session::write_state(uint16_t rejected, FrameWriter &reply) const {
    reply.text(",ST,");
    reply.number(static_cast<uint8_t>(motion_.mode()));
    reply.text(motion_.homed() ? ",1," : ",0,");
    reply.hexadecimal(motion_.faults());
    reply.comma();
    reply.micrometres(motion_.homed(), motion_.height_um());
    reply.comma();
    reply.micrometres(motion_.has_target(), motion_.target_um());
    const uint32_t figures[] = {motion_.raw(), motion_.now_ms(), rejected, last_};
    for (const uint32_t figure : figures) {
        reply.comma();
        reply.number(figure);
    }
}
