// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The position potentiometer: plausibility, and height from its reading. Pure.
#pragma once
#include <stdint.h>

#include "config.h"

class PositionSensor {
public:
    // Takes the latest reading and the count of readings; returns the faults present now.
    uint16_t update(uint16_t raw, uint8_t count, uint32_t now_ms);
    uint16_t causes() const { return causes_; }  // faults whose cause is still there
    uint16_t raw() const { return raw_; }
    int32_t height_um() const { return HOME_UM - (static_cast<int32_t>(home_raw_) - raw_) * UM_PER_RAW; }
    bool plausible_home() const;      // whether the reading is where the upper switch must be
    bool beyond_home() const { return raw_ > HOME_RAW + HOME_RAW_WINDOW; }
    void reference() { home_raw_ = raw_ + HOME_LAG_RAW; }  // on the way down the upper switch has just closed
    void reset_reference() { home_raw_ = HOME_RAW; }

private:
    uint16_t raw_ = 0;
    uint16_t home_raw_ = HOME_RAW;
    uint16_t causes_ = 0;
    uint8_t count_ = 0;
    bool started_ = false;
    uint32_t fresh_ms_ = 0;
};
