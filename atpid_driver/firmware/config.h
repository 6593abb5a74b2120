// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// Everything that belongs to one stand: wiring, calibration, limits. Check each line at the stand before the first flash
// (docs/stand.md, "Firmware"); the emulator's stand (emulator/stand.h) is built to the same figures.
#pragma once
#include <stdint.h>

#define FIRMWARE_VERSION "1.1.1"
constexpr uint8_t PROTOCOL_VERSION = 1;
constexpr uint32_t BAUD = 250000;  // exact from 16 MHz; 115200 would be 2.1 % off

// Wiring: port A, Arduino pins 22 to 27. Switches are normally closed to ground: an open contact or a broken wire stops.
constexpr uint8_t PIN_ENABLE = 22;  // PA0: high = motor current on; pulled down in hardware
constexpr uint8_t PIN_UP = 23;      // PA1: high = up (ceiling opens), low = down
constexpr uint8_t PIN_LOWER = 24;   // PA2: lower limit switch
constexpr uint8_t PIN_UPPER = 25;   // PA3: upper limit switch
constexpr uint8_t PIN_STOP = 26;    // PA4: auxiliary contact of the emergency stop
constexpr uint8_t ADC_CHANNEL = 0;  // A0: wiper of the position potentiometer, 1 Mohm to ground so that an open wiper reads 0

// Position: sum of 16 conversions (0 to 16368). The sensor is used between 5 and 95 % so that open and short are seen.
constexpr uint16_t RAW_LOW = 300;            // below: open or shorted to ground
constexpr uint16_t RAW_HIGH = 16068;         // above: shorted to supply
constexpr uint16_t RAW_JUMP = 160;           // from one sum to the next: 11 mm in 1.7 ms, twenty times the motor's speed
constexpr int32_t UM_PER_RAW = 70;           // calibration
constexpr uint16_t HOME_RAW = 15428;         // nominal reading where the upper switch closes on the way down
constexpr uint16_t HOME_RAW_WINDOW = 300;    // how far the potentiometer may have slipped: 21 mm
constexpr int32_t HOME_UM = 1010000;         // height there
constexpr uint16_t HOME_LAG_RAW = 3;         // way made between edge and reading: debouncing less the sensor's own lag

// Limits of travel and the one speed.
constexpr int32_t LOWEST_UM = 17000;         // the grain's diameter: never lower
constexpr int32_t HIGHEST_UM = 1000000;
constexpr int32_t SPEED_UM_PER_S = 300000;   // measured; stall and overtime are judged by it
constexpr int32_t STOP_LEAD_UM = 1000;       // switch off this far before the target: way made while the sensor and we react
constexpr int32_t DEAD_BAND_UM = 800;        // nearer than this is there already: two thirds of a step of the converter
constexpr int32_t SOFT_MARGIN_UM = 4000;     // this far outside the soft limits is a fault
constexpr int32_t SWITCH_MARGIN_UM = 50000;  // a limit switch open this far inside the travel is stuck or broken

// Times [ms].
constexpr uint16_t HEARTBEAT_MS = 480;       // motor is off before 500
constexpr uint16_t STALL_MS = 150;           // in each such window a quarter of the nominal travel must be made
constexpr uint16_t SETTLE_MS = 300;          // after switching off the ceiling may coast this long
constexpr uint16_t REVERSE_MS = 50;          // pause before the motor is reversed
constexpr uint16_t OVERTIME_MS = 500;        // a move may take twice its nominal time and this
constexpr uint16_t SENSOR_SILENT_MS = 20;
constexpr uint8_t DEBOUNCE_MS = 3;
constexpr int32_t COAST_UM = 8000;           // motion with the motor off beyond this is a fault
constexpr int32_t BACK_OFF_UM = 30000;       // the upper switch must close within this on the way down

static_assert(LOWEST_UM > 0 && LOWEST_UM < HIGHEST_UM && HIGHEST_UM < HOME_UM, "limits lie below the homing switch");
static_assert(HOME_RAW + HOME_RAW_WINDOW < RAW_HIGH, "homing must stay inside the sensor's range");
static_assert(HOME_RAW - (HOME_UM - LOWEST_UM) / UM_PER_RAW - HOME_RAW_WINDOW > RAW_LOW, "so must the lowest height");
