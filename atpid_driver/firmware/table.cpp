// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "table.h"

#ifdef __AVR__
#include <avr/pgmspace.h>
#else
#define PROGMEM
#define pgm_read_dword(address) (*(address))
#endif

#ifdef ATPID_TABLE
#include ATPID_TABLE  // defines ATPID_TABLE_N, atpid_amplitude_um and atpid_height_um

static_assert(sizeof atpid_amplitude_um == 4u * ATPID_TABLE_N && sizeof atpid_height_um == 4u * ATPID_TABLE_N,
              "atpid_amplitude_um and atpid_height_um must be uint32_t with ATPID_TABLE_N entries each");

namespace {
uint32_t amplitude_at(uint16_t index) { return pgm_read_dword(&atpid_amplitude_um[index]); }
}  // namespace

uint16_t table_size() { return ATPID_TABLE_N; }

bool table_height(uint32_t amplitude, int32_t &height) {
    if (amplitude < amplitude_at(0) || amplitude > amplitude_at(ATPID_TABLE_N - 1)) return false;
    uint16_t nearest = 0;
    while (amplitude_at(nearest) < amplitude) ++nearest;
    if (nearest > 0 && amplitude - amplitude_at(nearest - 1) < amplitude_at(nearest) - amplitude) --nearest;
    height = static_cast<int32_t>(pgm_read_dword(&atpid_height_um[nearest]));
    return true;
}
#else
uint16_t table_size() { return 0; }
bool table_height(uint32_t, int32_t &) { return false; }
#endif
