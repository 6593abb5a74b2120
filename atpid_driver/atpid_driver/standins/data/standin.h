// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* What both stand-in libraries share: a source of channel voltages, faults injected through a memory-mapped
 * control file, and a stream that produces scans by the clock (or as fast as a feed is written).
 * The file layouts are documented in device.py, which writes them.
 */
#ifndef ATPID_STANDIN_H
#define ATPID_STANDIN_H

#include <stddef.h>
#include <stdint.h>

#define STANDIN_MAX_CHANNELS 16
#define STANDIN_MAX_LOST 64

typedef struct {
    char magic[8]; /* "ATPIDCT1" */
    uint32_t plugged;
    uint32_t unplugs; /* counts, so that a pull between two calls is not missed */
    uint32_t serial;
    uint32_t stalled; /* the transfer to the host has halted, the device keeps sampling */
    uint64_t drop;    /* scans to lose, total since the start */
    int32_t fail_code; /* error the next read returns, once per count */
    uint32_t fail_count;
    uint32_t held; /* bit of each channel that gives hold_volts instead of its own: a dead or frozen sensor */
    uint32_t unused;
    double hold_volts[STANDIN_MAX_CHANNELS];
    double slow; /* share of the time that the device's clock loses, of a source that is no feed */
} Control;

typedef struct {
    char magic[8]; /* "ATPIDFD1" */
    uint32_t channels;
    uint32_t capacity; /* frames in the ring */
    double rate;       /* frames per second of the writer's time */
    uint64_t written;  /* frames written so far, stored after the data */
} Feed;

enum { SOURCE_SINE, SOURCE_RAMP, SOURCE_FEED };

typedef struct {
    int kind;
    double amplitude, offset, frequency; /* [V], [V], [Hz] */
    double common; /* 1: a sine that all devices of the host have in phase */
    const Feed *feed;
    size_t feed_size;
    uint64_t feed_start; /* first frame this stream sees */
} Source;

typedef enum { WAIT_OK, WAIT_TIMEOUT, WAIT_UNPLUGGED, WAIT_FULL, WAIT_FAILED } Wait;

typedef struct {
    Source source;
    const Control *control;
    double rate, skew; /* [scans/s], [s] between one channel and the next */
    int channels;
    int64_t start_ns;
    uint64_t next;      /* scan the client reads next */
    uint64_t moved;     /* scans that reached the host */
    uint64_t generated; /* scans the device has taken */
    uint64_t device_capacity, host_capacity; /* [scans] */
    uint64_t lost_from[STANDIN_MAX_LOST], lost_to[STANDIN_MAX_LOST];
    int lost;
    uint64_t drop_taken;
    uint32_t unplugs, fails;
    int32_t fail_code;
} Stream;

#define STANDIN_OUTPUTS 2
#define STANDIN_QUEUE 65536

/* What a device puts out, written by the library and read by device.py, which acts its watchdog: see there. */
typedef struct {
    char magic[8]; /* "ATPIDOU2" */
    /* in flash: the watchdog's registers, and the voltages at power-up */
    uint32_t watchdog, watchdog_s, watchdog_startup_s, watchdog_strict, watchdog_key, watchdog_resets;
    uint32_t watchdog_sets[STANDIN_OUTPUTS];
    double watchdog_volts[STANDIN_OUTPUTS], power_up[STANDIN_OUTPUTS];
    uint32_t flash;  /* times that something was written there */
    uint32_t booted; /* by the watchdog, which has not been fed since */
    uint32_t streams, target;
    double volts[STANDIN_OUTPUTS];
    int64_t fed_ns; /* when the watchdog was fed, by the monotonic clock */
    double rate;        /* of the streamed samples */
    int64_t start_ns;   /* of the stream */
    uint64_t written;   /* samples so far, stored after the data, which begin at byte 4096 */
} Output;

int64_t now_ns(void);
void output_write(Output *output, const double *volts, int count); /* appends to the queue */
void output_end(Output *output); /* of a stream: its last sample stays at the output */
void output_start(Output *output, double rate);
Output *output_open(const char *variable); /* the file named by an environment variable; NULL: there is none */
const Control *control_open(const char *variable); /* the file named by an environment variable, or a healthy device */
int source_open(Source *source, const char *specification); /* 0, or -1 if a feed is not there */
void source_close(Source *source);
void stream_start(Stream *stream);
void stream_pump(Stream *stream);
Wait stream_wait(Stream *stream, uint64_t scans, double timeout_s);
void stream_copy(Stream *stream, uint64_t scans, double *rows, double lost_value); /* row-major, oldest first */

#endif
