// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The fault table of docs/motor_protocol.md and atpid_driver/motor/faults.py: the same bits.
#pragma once
#include <stdint.h>

namespace fault {
constexpr uint16_t HEARTBEAT = 1u << 0;
constexpr uint16_t STALL = 1u << 1;
constexpr uint16_t SENSOR_LOW = 1u << 2;
constexpr uint16_t SENSOR_HIGH = 1u << 3;
constexpr uint16_t SENSOR_JUMP = 1u << 4;
constexpr uint16_t SENSOR_SILENT = 1u << 5;
constexpr uint16_t WRONG_WAY = 1u << 6;
constexpr uint16_t UNCOMMANDED = 1u << 7;
constexpr uint16_t LOWER_LIMIT = 1u << 8;
constexpr uint16_t UPPER_LIMIT = 1u << 9;
constexpr uint16_t BOTH_LIMITS = 1u << 10;
constexpr uint16_t EMERGENCY_STOP = 1u << 11;
constexpr uint16_t HOMING = 1u << 12;
constexpr uint16_t OVERTIME = 1u << 13;
constexpr uint16_t SOFT_LIMIT = 1u << 14;
constexpr uint16_t WATCHDOG = 1u << 15;

constexpr uint16_t SENSOR = SENSOR_LOW | SENSOR_HIGH | SENSOR_JUMP | SENSOR_SILENT;
constexpr uint16_t DISTRUST = SENSOR | WRONG_WAY | UNCOMMANDED | SOFT_LIMIT | HOMING;  // the reference is lost: home again
}  // namespace fault
