// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The motor: off, up or down at one constant speed, and whether the ceiling follows. Pure.
#pragma once
#include <stdint.h>

#include "config.h"

enum class Direction : int8_t { DOWN = -1, OFF = 0, UP = 1 };

class Drive {
public:
    void off(uint32_t now_ms);
    void settle(uint32_t now_ms);  // from now on judge the ceiling anew
    void go(Direction direction, uint32_t now_ms);  // waits REVERSE_MS before a reversal
    Direction direction() const { return direction_; }
    bool on() const { return direction_ != Direction::OFF; }
    // Compares the ceiling's motion with the motor's; returns the faults seen now.
    uint16_t check(int32_t height_um, uint32_t now_ms);

private:
    Direction direction_ = Direction::OFF;
    Direction last_ = Direction::OFF;
    uint32_t since_ms_ = 0;   // of the last switching
    uint32_t window_ms_ = 0;  // start of the present window of observation
    int32_t window_um_ = 0;
    bool fresh_ = true;       // the window has no start yet

    uint16_t check_running(int32_t height_um, uint32_t now_ms);
    uint16_t check_resting(int32_t height_um, uint32_t now_ms);
};
