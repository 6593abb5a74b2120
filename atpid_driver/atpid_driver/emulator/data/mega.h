// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* An ATmega2560 in libsimavr with the real firmware in it, wired to a stand. Time is the AVR's own, in cycles. */
#ifndef ATPID_MEGA_H
#define ATPID_MEGA_H
#include <simavr/sim_avr.h>
#include <stddef.h>
#include <stdint.h>

#include "stand.h"

#define MEGA_HZ 16000000ull
#define MEGA_STEP 640ull /* cycles between two updates of the stand: 40 us, a byte at 250 kbaud */
#define QUEUE 65536u

struct queue {
    uint8_t bytes[QUEUE];
    size_t head, count;
};

struct mega {
    avr_t *avr;            /* NULL: power off */
    struct stand stand;
    const char *elf, *eeprom;
    uint64_t clock;        /* cycles since the emulator was started: goes on over resets and power cuts */
    uint64_t seen;         /* avr->cycle up to which `clock` counts */
    uint64_t stuck_until;  /* in the bootloader until then */
    uint64_t bootloader;   /* cycles */
    uint64_t motor_off_at; /* clock when the motor was last switched off */
    uint64_t unserved;     /* clock when the watchdog's interrupt began to wait; 0: it does not */
    uint64_t last_byte_at; /* clock when the board was last sent a byte */
    int paused;            /* simavr's receiver requests a pause */
    unsigned resets;       /* restarts of any kind since the emulator was started */
    struct queue to_board, from_board;
};

int queue_put(struct queue *queue, uint8_t byte); /* 0: full */
int queue_take(struct queue *queue);              /* -1: empty */

int mega_power_on(struct mega *mega);             /* 0: the firmware cannot be loaded */
void mega_power_off(struct mega *mega);
void mega_reset(struct mega *mega);               /* the reset button, or a host opening the port */
void mega_hang(struct mega *mega, int interrupts); /* the main program never returns; only the watchdog helps */
void mega_run(struct mega *mega, uint64_t cycles);
const char *mega_state(const struct mega *mega);
#endif
