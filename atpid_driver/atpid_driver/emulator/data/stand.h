// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* The ceiling as the board sees it: a motor of one speed, a potentiometer, two limit switches, an emergency stop.
 * Its figures are those of firmware/config.h. Every way to break is a field of struct stand. */
#ifndef ATPID_STAND_H
#define ATPID_STAND_H
#include <stdint.h>

enum contact { CONTACT_OK, CONTACT_OPEN, CONTACT_CLOSED };             /* follows the ceiling, stuck or broken, welded */
enum sensor { SENSOR_OK, SENSOR_OPEN, SENSOR_HIGH, SENSOR_FROZEN };    /* open reads as shorted to ground */

struct stand {
    double height_um;
    double speed_um_per_s;
    double travel_um;      /* way made, up and down together */
    int motor;             /* -1 down, 0 off, 1 up: what the board commands */
    int jam;               /* the ceiling does not move */
    int swapped;           /* motor leads swapped */
    int runaway;           /* motor runs up though it is off */
    double slip_um;        /* potentiometer turned on its shaft */
    double frozen_um;
    enum sensor sensor;
    enum contact lower, upper, stop;
    uint32_t noise;
    uint64_t switched;     /* how often the motor went on or off */
};

void stand_begin(struct stand *stand, double height_um);
void stand_step(struct stand *stand, double seconds);
int stand_lower_open(const struct stand *stand);
int stand_upper_open(const struct stand *stand);
int stand_stop_open(const struct stand *stand);
uint32_t stand_millivolts(struct stand *stand);  /* at the wiper, with the noise of one conversion */
int stand_set(struct stand *stand, const char *name, const char *value);  /* 0: no such name or value */
#endif
