// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "sensor.h"

#include "faults.h"

uint16_t PositionSensor::update(uint16_t raw, uint8_t count, uint32_t now_ms) {
    uint16_t jumped = 0;
    if (count != count_) {
        const uint16_t step = raw > raw_ ? raw - raw_ : raw_ - raw;
        if (started_ && step > RAW_JUMP) jumped = fault::SENSOR_JUMP;
        started_ = true;
        count_ = count;
        raw_ = raw;
        fresh_ms_ = now_ms;
    }
    causes_ = 0;
    if (started_ && raw_ < RAW_LOW) causes_ |= fault::SENSOR_LOW;
    if (started_ && raw_ > RAW_HIGH) causes_ |= fault::SENSOR_HIGH;
    if (now_ms - fresh_ms_ > SENSOR_SILENT_MS) causes_ |= fault::SENSOR_SILENT;
    return causes_ | jumped;
}

bool PositionSensor::plausible_home() const { return !beyond_home() && raw_ >= HOME_RAW - HOME_RAW_WINDOW; }
