// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The firmware's pure part on the host, under address and undefined-behaviour checks: random requests, a random stand that
// injects and clears, and after each millisecond an independent observer of when the motor may run.
//
//   check [MILLISECONDS] [SEED] [EVERY]      0: all held; 1: the first rule broken, in words
//
// EVERY: a storm, a request in so many milliseconds on average, of any number, to a stand without faults.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>

#include "../faults.h"
#include "../session.h"

namespace {

std::mt19937 rng;
uint32_t below(uint32_t end) { return rng() % end; }
bool one_in(uint32_t count) { return below(count) == 0; }
bool storm = false;

// A height to request: mostly one that may be, and in a storm anything.
long number() {
    static const uint32_t odd[] = {0, 1, 16999, 17000, 1000000, 1000001, 99999999, 4294967295u, 2147483648u};
    if (!storm || !one_in(3)) return static_cast<long>(below(1100000));
    return static_cast<long>(one_in(2) ? rng() : odd[below(sizeof odd / sizeof *odd)]);
}

struct Stand {
    double height_um = 500000;
    bool jam = false, swapped = false, lower_stuck = false, upper_stuck = false, stop = false, silent = false;
    int sensor = 0;   // 0 right, 1 open, 2 high
    double slip = 0;  // of the potentiometer on its shaft

    void move(Direction direction) {
        if (jam) return;
        height_um += (swapped ? -1 : 1) * static_cast<int>(direction) * SPEED_UM_PER_S / 1000.0;
        height_um = std::min(std::max(height_um, 12000.0), 1015000.0);
    }

    Inputs inputs(uint32_t now_ms) const {
        const double raw = HOME_RAW + slip - (HOME_UM - height_um) / UM_PER_RAW + below(16);
        const uint16_t seen = sensor == 1 ? 0 : sensor == 2 ? 16368 : static_cast<uint16_t>(raw);
        return Inputs{now_ms, seen, static_cast<uint8_t>(silent ? 0 : now_ms), lower_stuck || height_um < 14500, upper_stuck || height_um > HOME_UM, stop};
    }

    void change_faults() {
        jam = one_in(8);
        swapped = one_in(16);
        lower_stuck = one_in(12);
        upper_stuck = one_in(12);
        stop = one_in(12);
        silent = one_in(16);
        slip = one_in(3) ? below(200) - 100.0 : 0;
        sensor = one_in(6) ? 1 + static_cast<int>(below(2)) : 0;
    }
    void clear_faults() { *this = Stand{height_um}; }
};

// What is observed from outside: how long each contact has been open, when the host last sent a heartbeat, what it requested.
struct Observer {
    uint32_t lower_ms = 0, upper_ms = 0, stop_ms = 0, sensor_ms = 0, silent_ms = 0, alive_at = 0;
    uint8_t count = 0;  // of sums
    bool requested = false;  // HOME or MOVE accepted since the motor was last armed
    const char *violation = nullptr;  // rule broken in an answer
    uint64_t ran_ms = 0, homings = 0, faults = 0, requests = 0;

    void update(const Inputs &inputs) {
        lower_ms = inputs.lower_open ? lower_ms + 1 : 0;
        upper_ms = inputs.upper_open ? upper_ms + 1 : 0;
        stop_ms = inputs.stop_open ? stop_ms + 1 : 0;
        sensor_ms = inputs.raw < RAW_LOW || inputs.raw > RAW_HIGH ? sensor_ms + 1 : 0;
        silent_ms = inputs.count == count ? silent_ms + 1 : 0;
        count = inputs.count;
    }

    const char *broken_rule(const Motion &motion, uint32_t now_ms) const {
        if (violation) return violation;
        if (motion.has_target() && (motion.target_um() < LOWEST_UM - SOFT_MARGIN_UM || motion.target_um() > HIGHEST_UM + SOFT_MARGIN_UM))
            return "a target outside the soft limits";
        if (motion.mode() == Mode::FAULT && !motion.faults()) return "a fault without a name";
        if (motion.direction() == Direction::OFF) return nullptr;
        if (motion.faults()) return "runs with a fault";
        if (motion.mode() != Mode::HOMING && motion.mode() != Mode::MOVING) return "runs while at rest or disarmed";
        if (motion.mode() == Mode::MOVING && !motion.homed()) return "travels without having homed";
        if (!requested) return "runs although it was not requested since it was armed";
        if (now_ms - alive_at > 500) return "runs 500 ms after the last heartbeat";
        if (motion.direction() == Direction::DOWN && lower_ms > DEBOUNCE_MS) return "runs down into the lower switch";
        if (motion.direction() == Direction::UP && upper_ms > DEBOUNCE_MS) return "runs up into the upper switch";
        if (stop_ms > DEBOUNCE_MS) return "runs with the emergency stop pressed";
        if (sensor_ms > 1) return "runs with a sensor out of range";
        if (silent_ms > SENSOR_SILENT_MS) return "runs with a sensor that is not converted";
        return nullptr;
    }
};

class Host {
public:
    explicit Host(Session &session) : session_(session) {}

    // Sends one request as bytes through the parser; returns its answer, empty if it was dropped.
    std::string send(const char *word, long number = -1) {
        if (!one_in(10)) ++sequence_;
        const uint16_t sent = one_in(10) ? static_cast<uint16_t>(sequence_ - below(50)) : sequence_;  // repeated or old
        old = static_cast<int16_t>(sent - taken_) < 0;
        char body[40];
        number < 0 ? std::snprintf(body, sizeof body, "%u,%s", sent, word)
                   : std::snprintf(body, sizeof body, "%u,%s,%ld", sent, word, number);
        uint16_t crc = 0;
        for (const char *at = body; *at; ++at) crc = crc16(crc, static_cast<uint8_t>(*at));
        char frame[64];
        std::snprintf(frame, sizeof frame, "$%s*%04X\n", body, crc);
        if (one_in(5)) frame[below(static_cast<uint32_t>(std::strlen(frame)))] = static_cast<char>(below(256));
        const std::string answer = bytes(frame, std::strlen(frame));
        if (answer.find(",OLD*") == std::string::npos && answer.find(",SESSION*") == std::string::npos && !answer.empty()) taken_ = sent;
        return answer;
    }

    bool old = false;  // whether the last request was older than one carried out before

    std::string bytes(const char *data, size_t count) {
        std::string answer;
        Request request;
        for (size_t i = 0; i < count; ++i) {
            if (!parser_.take(static_cast<uint8_t>(data[i]), request)) continue;
            FrameWriter reply;
            session_.answer(request, parser_.rejected(), reply);
            answer = reply.finish();
        }
        return answer;
    }

private:
    Session &session_;
    FrameParser parser_;
    uint16_t sequence_ = 0, taken_ = 0;
};

bool contains(const std::string &text, const char *part) { return text.find(part) != std::string::npos; }

void exchange(Host &host, Observer &observer, const Motion &motion, uint32_t now_ms) {
    static const char *const words[] = {"BEAT", "BEAT", "BEAT", "ARM", "HOME", "MOVE", "MOVE", "STATE", "STOP", "DISARM", "ID", "LOOKUP", "NONE"};
    const uint32_t chosen = below(one_in(20) ? 13 : 7);
    const bool was_armed = motion.mode() != Mode::DISARMED && motion.mode() != Mode::FAULT;
    const bool numbered = chosen == 5 || chosen == 6 || chosen == 11;
    const std::string answer = host.send(words[chosen], numbered ? number() : -1L);
    if (!contains(answer, ",ST,") && !contains(answer, ",NO,")) {
        if (contains(answer, ",ID,")) observer.requested = false;
        return;
    }
    observer.alive_at = now_ms;  // generous: here every answered request counts; true silence is what must stop the motor
    const bool armed = motion.mode() != Mode::DISARMED && motion.mode() != Mode::FAULT;
    if (!was_armed && armed) observer.requested = false;
    if (!was_armed && armed && chosen != 3) observer.violation = "armed by something else than ARM";
    if (host.old && contains(answer, ",ST,")) observer.violation = "carried out an old request";
    if (armed && contains(answer, ",ST,") && (chosen == 4 || chosen == 5 || chosen == 6)) observer.requested = true;
}

void noise(Host &host) {
    char data[80];
    const uint32_t count = below(sizeof data);
    const bool readable = one_in(4);  // as a frame that does not end
    for (uint32_t i = 0; i < count; ++i) data[i] = static_cast<char>(readable ? ' ' + below('~' - ' ') : one_in(6) ? '$' : below(256));
    if (readable) data[0] = '$';
    host.bytes(data, count);
}

// Without faults of the stand a ceiling that has homed stays where it may be.
bool outside(const Motion &motion, const Stand &stand) {
    return storm && motion.homed() && (stand.height_um < LOWEST_UM - SOFT_MARGIN_UM || stand.height_um > HIGHEST_UM + SOFT_MARGIN_UM);
}

}  // namespace

int main(int count, char **words) {
    const uint64_t length = count > 1 ? std::strtoull(words[1], nullptr, 10) : 5000000;
    rng.seed(count > 2 ? static_cast<uint32_t>(std::strtoul(words[2], nullptr, 10)) : 1);
    const uint32_t every = count > 3 ? static_cast<uint32_t>(std::strtoul(words[3], nullptr, 10)) : 60;
    storm = count > 3;
    Motion motion;
    const Board board{1, "POWER"};
    Session session(motion, board);
    Host host(session);
    Stand stand;
    Observer observer;
    bool quiet = false, was_homed = false;
    uint32_t now_ms = 4294000000u;  // the clock wraps round early on
    for (uint64_t step = 0; step < length; ++step, ++now_ms) {
        if (!storm && one_in(4000)) one_in(2) ? stand.change_faults() : stand.clear_faults();
        if (one_in(5000)) quiet = !quiet;
        if (!quiet && one_in(every)) {
            exchange(host, observer, motion, now_ms);
            ++observer.requests;
        }
        if (one_in(200)) noise(host);
        const Inputs inputs = stand.inputs(now_ms);
        observer.update(inputs);
        motion.step(inputs);
        stand.move(motion.direction());
        observer.ran_ms += motion.direction() != Direction::OFF;
        observer.homings += motion.homed() && !was_homed;
        observer.faults |= motion.faults();
        was_homed = motion.homed();
        const char *broken = outside(motion, stand) ? "a height outside the soft limits" : observer.broken_rule(motion, now_ms);
        if (broken) {
            std::printf("after %llu ms: %s (mode %u, height %.0f um)\n", static_cast<unsigned long long>(step), broken,
                        static_cast<unsigned>(motion.mode()), stand.height_um);
            return 1;
        }
    }
    std::printf("%llu requests in %llu ms, motor on for %llu ms, homed %llu times, faults seen %04llX: every rule held\n",
                static_cast<unsigned long long>(observer.requests), static_cast<unsigned long long>(length), static_cast<unsigned long long>(observer.ran_ms),
                static_cast<unsigned long long>(observer.homings), static_cast<unsigned long long>(observer.faults));
    return 0;
}
