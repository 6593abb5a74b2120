// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The Mega 2560 itself: pins, converter, boot counter, reset cause, watchdog. Nothing here decides anything.
#pragma once
#include "motion.h"
#include "session.h"

void board_begin();              // pins first: the motor is off before anything else runs
Board board_describe();          // counts this boot
bool board_watchdog_latched();   // in the EEPROM: opening the port resets the board, and a bootloader clears the reset flags
void board_latch_watchdog(bool latched);
Inputs board_inputs(uint32_t now_ms);
void board_drive(Direction direction);
void board_alive();              // feeds the watchdog
void board_rest();               // sleeps until the next interrupt
