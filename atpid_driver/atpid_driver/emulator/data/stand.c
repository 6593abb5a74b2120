// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "stand.h"

#include <stdlib.h>
#include <string.h>

#define END_LOW_UM 12000.0
#define LOWER_SWITCH_UM 14500.0
#define UPPER_SWITCH_UM 1010000.0
#define END_HIGH_UM 1015000.0
#define HOME_RAW 15428.0
#define UM_PER_RAW 70.0

void stand_begin(struct stand *stand, double height_um) {
    memset(stand, 0, sizeof *stand);
    stand->height_um = height_um;
    stand->speed_um_per_s = 300000.0;
    stand->noise = 1;
}

void stand_step(struct stand *stand, double seconds) {
    int direction = stand->runaway ? 1 : stand->swapped ? -stand->motor : stand->motor;
    double before = stand->height_um;
    if (stand->jam) direction = 0;
    stand->height_um += direction * stand->speed_um_per_s * seconds;
    if (stand->height_um < END_LOW_UM) stand->height_um = END_LOW_UM;
    if (stand->height_um > END_HIGH_UM) stand->height_um = END_HIGH_UM;
    stand->travel_um += stand->height_um > before ? stand->height_um - before : before - stand->height_um;
}

static int open_contact(enum contact contact, int pressed) {
    return contact == CONTACT_OK ? pressed : contact == CONTACT_OPEN;
}

int stand_lower_open(const struct stand *stand) {
    return open_contact(stand->lower, stand->height_um <= LOWER_SWITCH_UM);
}

int stand_upper_open(const struct stand *stand) {
    return open_contact(stand->upper, stand->height_um >= UPPER_SWITCH_UM);
}

int stand_stop_open(const struct stand *stand) { return open_contact(stand->stop, 0); }

uint32_t stand_millivolts(struct stand *stand) {
    double height = stand->sensor == SENSOR_FROZEN ? stand->frozen_um : stand->height_um;
    double step = (HOME_RAW - (UPPER_SWITCH_UM - height - stand->slip_um) / UM_PER_RAW) / 16.0;
    if (stand->sensor == SENSOR_OPEN) return 0;
    if (stand->sensor == SENSOR_HIGH) return 5000;
    stand->noise = stand->noise * 1664525u + 1013904223u;
    step += (double)(stand->noise >> 8) / (1 << 24); /* one step of noise: what makes an average finer than one step */
    return step < 0 ? 0 : (uint32_t)(step * 5000.0 / 1023.0 + 0.5);
}

static int choose(const char *value, const char *const *names, int count) {
    for (int i = 0; i < count; ++i)
        if (!strcmp(value, names[i])) return i;
    return -1;
}

static int set_contact(enum contact *contact, const char *value) {
    static const char *const names[] = {"ok", "open", "closed"};
    int chosen = choose(value, names, 3);
    if (chosen >= 0) *contact = (enum contact)chosen;
    return chosen >= 0;
}

static int set_sensor(struct stand *stand, const char *value) {
    static const char *const names[] = {"ok", "open", "high", "frozen"};
    int chosen = choose(value, names, 4);
    stand->frozen_um = stand->height_um;
    if (chosen >= 0) stand->sensor = (enum sensor)chosen;
    return chosen >= 0;
}

static int set_number(double *number, const char *value) {
    char *end;
    double given = strtod(value, &end);
    if (end == value || *end) return 0;
    *number = given;
    return 1;
}

static int set_flag(int *flag, const char *value) {
    *flag = !strcmp(value, "1");
    return *flag || !strcmp(value, "0");
}

int stand_set(struct stand *stand, const char *name, const char *value) {
    if (!strcmp(name, "jam")) return set_flag(&stand->jam, value);
    if (!strcmp(name, "swapped")) return set_flag(&stand->swapped, value);
    if (!strcmp(name, "runaway")) return set_flag(&stand->runaway, value);
    if (!strcmp(name, "sensor")) return set_sensor(stand, value);
    if (!strcmp(name, "lower")) return set_contact(&stand->lower, value);
    if (!strcmp(name, "upper")) return set_contact(&stand->upper, value);
    if (!strcmp(name, "stop")) return set_contact(&stand->stop, value);
    if (!strcmp(name, "height")) return set_number(&stand->height_um, value);
    if (!strcmp(name, "speed")) return set_number(&stand->speed_um_per_s, value);
    if (!strcmp(name, "slip")) return set_number(&stand->slip_um, value);
    return 0;
}
