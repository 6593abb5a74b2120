// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* The emulated motor stand: the real firmware on an emulated Mega 2560, its serial port a pty.
 *
 *   emulator FIRMWARE.elf [--link PATH] [--eeprom FILE] [--height UM] [--bootloader MS] [--reset-on-open]
 *
 * Commands on standard input, one answer each on standard output: "ok", "error ...", or one line of JSON.
 *   run MS | drain MS      advance simulated time as fast as possible; drain first lets the board take in what was sent
 *   pace X                 from now on run by itself, X times real time; 0: stand still (a hung board)
 *   set NAME VALUE         stand.h: jam, swapped, runaway, sensor, lower, upper, stop, height, speed, slip
 *   reset | hang | hang off | power 0|1 | unplug | plug      hang off: with interrupts off
 *   send HEX | recv        talk to the board without the pty (while unplugged)
 *   state                  the stand and the board as JSON
 *   quit                   or end of input: power off and leave
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "mega.h"

#define CYCLES_A_MS (MEGA_HZ / 1000)
#define LONGEST_SLICE (5 * CYCLES_A_MS)
#define LARGEST_LAG (100 * CYCLES_A_MS)

struct host {
    int master;        /* -1: unplugged */
    const char *link;
    int reset_on_open;
    int open;          /* a host has the port open */
    double pace;
    double paced_from; /* wall time [s] at which `paced_clock` was right */
    uint64_t paced_clock;
};

static struct mega mega;
static struct host host = {.master = -1};

static double wall(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void set_pace(double pace) {
    host.pace = pace;
    host.paced_from = wall();
    host.paced_clock = mega.clock;
}

/* Whether `link` leads to a pty, as one that an emulator made does; nothing else is ever removed. */
static int leads_to_pty(const char *link) {
    static const char PTY[] = "/dev/pts/";
    char target[128];
    ssize_t length = readlink(link, target, sizeof target);
    return length >= (ssize_t)sizeof PTY - 1 && memcmp(target, PTY, sizeof PTY - 1) == 0;
}

static void unplug(void) {
    if (host.master < 0) return;
    if (host.link && leads_to_pty(host.link)) unlink(host.link);
    close(host.master);
    host.master = -1;
    host.open = 0;
    mega.to_board.count = mega.from_board.count = 0;
}

static int plug(void) {
    char name[128];
    struct termios raw;
    int slave;
    if (host.master >= 0) return 1;
    cfmakeraw(memset(&raw, 0, sizeof raw));
    if (openpty(&host.master, &slave, name, &raw, NULL) != 0) return 0;
    close(slave); /* so that a host's opening and closing can be seen */
    fcntl(host.master, F_SETFL, O_NONBLOCK);
    fcntl(host.master, F_SETFD, FD_CLOEXEC);
    if (!host.link) return 1;
    if (leads_to_pty(host.link)) unlink(host.link);
    return symlink(name, host.link) == 0;
}

static void exchange_with_host(void) {
    uint8_t bytes[512];
    struct pollfd port = {.fd = host.master, .events = POLLIN};
    if (host.master < 0) return;
    poll(&port, 1, 0);
    int open = !(port.revents & POLLHUP);
    if (open && !host.open && host.reset_on_open) mega_reset(&mega);
    host.open = open;
    while (mega.to_board.count < QUEUE / 2) {
        ssize_t got = read(host.master, bytes, sizeof bytes);
        if (got <= 0) break;
        for (ssize_t i = 0; i < got; ++i) queue_put(&mega.to_board, bytes[i]);
    }
    while (mega.from_board.count) {
        uint8_t byte = mega.from_board.bytes[mega.from_board.head];
        if (open && write(host.master, &byte, 1) != 1) break;
        queue_take(&mega.from_board);
    }
}

/* Follows the wall clock in slices, so that host and board answer each other within a few milliseconds. */
static void follow_clock(void) {
    double due = (double)host.paced_clock + (wall() - host.paced_from) * host.pace * (double)MEGA_HZ;
    if (due - (double)mega.clock > (double)LARGEST_LAG) {
        set_pace(host.pace);
        due = (double)mega.clock + (double)LONGEST_SLICE;
    }
    uint64_t goal = (uint64_t)due;
    if (goal <= mega.clock) return;
    mega_run(&mega, goal - mega.clock < LONGEST_SLICE ? goal - mega.clock : LONGEST_SLICE);
}

static void print_state(void) {
    const struct stand *stand = &mega.stand;
    printf("{\"board\": \"%s\", \"ms\": %.3f, \"motor\": %d, \"height_um\": %.1f, \"travel_um\": %.1f, \"switched\": %llu, "
           "\"resets\": %u, \"motor_off_ms\": %.3f, \"last_byte_ms\": %.3f, \"open\": %d}\n",
           mega_state(&mega), (double)mega.clock / CYCLES_A_MS, stand->motor, stand->height_um, stand->travel_um,
           (unsigned long long)stand->switched, mega.resets, (double)mega.motor_off_at / CYCLES_A_MS,
           (double)mega.last_byte_at / CYCLES_A_MS, host.open);
}

static int send_hex(const char *text) {
    unsigned byte;
    int used;
    while (sscanf(text, "%2x%n", &byte, &used) == 1) {
        if (!queue_put(&mega.to_board, (uint8_t)byte)) return 0;
        text += used;
    }
    return 1;
}

static void print_received(void) {
    int byte;
    while ((byte = queue_take(&mega.from_board)) >= 0) printf("%02x", (unsigned)byte);
    printf("\n");
}

static void drain(uint64_t cycles) {
    while (mega.to_board.count) mega_run(&mega, MEGA_STEP);
    mega_run(&mega, cycles);
}

/* Returns what to answer, or NULL when it has answered itself. */
static const char *obey(char *line) {
    char *word = strtok(line, " \n"), *first = strtok(NULL, " \n"), *second = strtok(NULL, " \n");
    if (!word) return "error no command";
    if (!strcmp(word, "state")) return print_state(), NULL;
    if (!strcmp(word, "recv")) return print_received(), NULL;
    if (!strcmp(word, "reset")) return mega_reset(&mega), "ok";
    if (!strcmp(word, "hang")) return mega_hang(&mega, !first || strcmp(first, "off")), "ok";
    if (!strcmp(word, "unplug")) return unplug(), "ok";
    if (!strcmp(word, "plug")) return plug() ? "ok" : "error no pty";
    if (!first) return "error unknown command, or its value is missing";
    if (!strcmp(word, "run")) return mega_run(&mega, (uint64_t)(atof(first) * CYCLES_A_MS)), "ok";
    if (!strcmp(word, "drain")) return drain((uint64_t)(atof(first) * CYCLES_A_MS)), "ok";
    if (!strcmp(word, "pace")) return set_pace(atof(first)), "ok";
    if (!strcmp(word, "send")) return send_hex(first) ? "ok" : "error queue full";
    if (!strcmp(word, "power")) {
        if (strcmp(first, "1")) return mega_power_off(&mega), "ok";
        return mega_power_on(&mega) ? "ok" : "error firmware cannot be loaded";
    }
    if (!strcmp(word, "set") && second) return stand_set(&mega.stand, first, second) ? "ok" : "error no such name or value";
    return "error unknown command";
}

/* Takes commands as they come; returns 0 at the end of input. */
static int take_commands(int wait_ms) {
    static char line[2 * QUEUE + 16];
    static size_t length;
    struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
    if (poll(&input, 1, wait_ms) <= 0) return 1;
    ssize_t got = read(STDIN_FILENO, line + length, sizeof line - 1 - length);
    if (got <= 0) return 0;
    length += (size_t)got;
    for (;;) {
        line[length] = '\0';
        char *end = strchr(line, '\n');
        if (!end) return length < sizeof line - 1;
        size_t used = (size_t)(end + 1 - line);
        *end = '\0';
        if (!strcmp(line, "quit")) return 0;
        const char *answer = obey(line);
        if (answer) puts(answer);
        fflush(stdout);
        length -= used;
        memmove(line, line + used, length);
    }
}

static int parse(int count, char **words) {
    double height = 300000.0;
    if (count < 2) return 0;
    mega.elf = words[1];
    for (int i = 2; i < count; ++i) {
        if (!strcmp(words[i], "--reset-on-open")) host.reset_on_open = 1;
        else if (i + 1 == count) return 0;
        else if (!strcmp(words[i], "--link")) host.link = words[++i];
        else if (!strcmp(words[i], "--eeprom")) mega.eeprom = words[++i];
        else if (!strcmp(words[i], "--height")) height = atof(words[++i]);
        else if (!strcmp(words[i], "--bootloader")) mega.bootloader = (uint64_t)(atof(words[++i]) * CYCLES_A_MS);
        else return 0;
    }
    stand_begin(&mega.stand, height);
    return 1;
}

int main(int count, char **words) {
    if (!parse(count, words)) {
        fprintf(stderr, "usage: emulator FIRMWARE.elf [--link PATH] [--eeprom FILE] [--height UM] [--bootloader MS] "
                        "[--reset-on-open]\n");
        return 2;
    }
    if (!mega_power_on(&mega) || !plug()) {
        fprintf(stderr, "emulator: cannot load %s or open a pty: %s\n", mega.elf, strerror(errno));
        return 2;
    }
    puts("ready");
    fflush(stdout);
    while (take_commands(1)) {
        exchange_with_host();
        if (host.pace > 0) follow_clock();
        exchange_with_host();
    }
    mega_power_off(&mega);
    unplug();
    return 0;
}
