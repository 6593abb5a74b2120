// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// Ceiling motor of the ATPID on an Arduino Mega 2560: protocol in docs/motor_protocol.md, stand in config.h.
#include <Arduino.h>

#include "board.h"
#include "faults.h"

namespace {

constexpr uint8_t BYTES_A_TURN = 16;  // so that a flood of bytes cannot delay the control of the motor

Motion motion;
Board board;
Session session(motion, board);
FrameParser parser;

// Never waits: a host that does not read its answers loses them, the control of the motor goes on.
void send(FrameWriter &reply) {
    const char *bytes = reply.finish();
    if (Serial.availableForWrite() >= reply.length()) Serial.write(bytes, reply.length());
}

void receive() {
    Request request;
    for (uint8_t turn = 0; turn < BYTES_A_TURN && Serial.available(); ++turn) {
        if (!parser.take(static_cast<uint8_t>(Serial.read()), request)) continue;
        FrameWriter reply;
        session.answer(request, parser.rejected(), reply);
        send(reply);
        return;
    }
}

}  // namespace

void setup() {
    board_begin();
    board = board_describe();
    if (board_watchdog_latched()) motion = Motion(fault::WATCHDOG);
    Serial.begin(BAUD);
}

void loop() {
    static uint32_t last_ms = 0;
    const uint32_t now_ms = millis();
    if (now_ms != last_ms) {
        last_ms = now_ms;
        motion.step(board_inputs(now_ms));
        board_alive();
    }
    receive();
    if (!(motion.faults() & fault::WATCHDOG)) board_latch_watchdog(false);  // until it has been armed
    board_drive(motion.direction());
    if (!Serial.available()) board_rest();
}
