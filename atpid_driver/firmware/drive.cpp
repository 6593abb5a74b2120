// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "drive.h"

#include "faults.h"

namespace {
constexpr int32_t NOMINAL_UM = SPEED_UM_PER_S / 1000 * STALL_MS;
}

void Drive::off(uint32_t now_ms) {
    if (!on()) return;
    direction_ = Direction::OFF;
    settle(now_ms);
}

void Drive::settle(uint32_t now_ms) {
    since_ms_ = now_ms;
    fresh_ = true;
}

void Drive::go(Direction direction, uint32_t now_ms) {
    if (direction == direction_) return;
    if (on()) off(now_ms);
    const bool reversal = last_ != Direction::OFF && direction != last_;
    if (reversal && now_ms - since_ms_ < REVERSE_MS) return;
    direction_ = last_ = direction;
    settle(now_ms);
}

uint16_t Drive::check(int32_t height_um, uint32_t now_ms) {
    if (fresh_) {
        fresh_ = false;
        window_ms_ = now_ms;
        window_um_ = height_um;
    }
    return on() ? check_running(height_um, now_ms) : check_resting(height_um, now_ms);
}

uint16_t Drive::check_running(int32_t height_um, uint32_t now_ms) {
    const int32_t made = (height_um - window_um_) * static_cast<int8_t>(direction_);
    if (made < -COAST_UM) return fault::WRONG_WAY;
    if (now_ms - window_ms_ < STALL_MS) return 0;
    window_ms_ = now_ms;
    window_um_ = height_um;
    return made < NOMINAL_UM / 4 ? fault::STALL : 0;
}

uint16_t Drive::check_resting(int32_t height_um, uint32_t now_ms) {
    if (now_ms - since_ms_ < SETTLE_MS) {
        window_um_ = height_um;
        return 0;
    }
    const int32_t moved = height_um > window_um_ ? height_um - window_um_ : window_um_ - height_um;
    return moved > COAST_UM ? fault::UNCOMMANDED : 0;
}
