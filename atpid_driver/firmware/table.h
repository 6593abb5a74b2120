// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The optional look-up table of best heights on board, as in the thesis: the nearest recorded amplitude's height.
// `make TABLE=path/to/table.h` builds one in; docs/motor_protocol.md documents the header's format.
#pragma once
#include <stdint.h>

uint16_t table_size();                                    // 0: none
bool table_height(uint32_t amplitude, int32_t &height);  // [um]; false: no table, or amplitude outside it
