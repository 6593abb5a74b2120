// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0

#include "standin.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define DATA_OFFSET 4096
#define KNOWN 256 /* control files one process can name */
#define SLICE_NS 2000000 /* longest sleep before a fault is noticed */

static const Control HEALTHY = {.magic = "ATPIDCT1", .plugged = 1, .serial = 470012345};

int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static const void *map_file(const char *path, const char *magic, size_t *size) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    struct stat status;
    if (fd < 0) return NULL;
    if (fstat(fd, &status) != 0 || status.st_size < DATA_OFFSET) {
        close(fd);
        return NULL;
    }
    void *memory = mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (memory == MAP_FAILED) return NULL;
    if (memcmp(memory, magic, 8) != 0) {
        munmap(memory, (size_t)status.st_size);
        return NULL;
    }
    *size = (size_t)status.st_size;
    return memory;
}

/* Mapped once a path and kept: clients hold handles to it until the process ends. */
const Control *control_open(const char *variable) {
    static struct { char path[512]; const Control *control; } known[KNOWN];
    const char *path = getenv(variable);
    size_t size;
    if (path == NULL || *path == 0 || strlen(path) >= sizeof known[0].path) return &HEALTHY;
    for (int i = 0; i < KNOWN; i++) {
        if (strcmp(known[i].path, path) == 0) return known[i].control;
    }
    const Control *control = map_file(path, "ATPIDCT1", &size);
    if (control == NULL) return &HEALTHY;
    for (int i = 0; i < KNOWN; i++) {
        if (known[i].path[0] == 0) {
            strcpy(known[i].path, path);
            known[i].control = control;
            return control;
        }
    }
    return control; /* more of them: mapped anew each time */
}

Output *output_open(const char *variable) {
    const char *path = getenv(variable);
    int fd = path == NULL || *path == 0 ? -1 : open(path, O_RDWR | O_CLOEXEC);
    size_t size = DATA_OFFSET + STANDIN_QUEUE * sizeof(double);
    struct stat status;
    if (fd < 0) return NULL;
    void *memory = fstat(fd, &status) != 0 || (size_t)status.st_size < size
                       ? MAP_FAILED : mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    if (memory == MAP_FAILED) return NULL;
    if (memcmp(memory, "ATPIDOU2", 8) == 0) return memory;
    munmap(memory, size);
    return NULL;
}

void output_write(Output *output, const double *volts, int count) {
    double *queue = (double *)((char *)output + DATA_OFFSET);
    for (int i = 0; i < count; i++) queue[(output->written + (uint64_t)i) % STANDIN_QUEUE] = volts[i];
    __atomic_store_n(&output->written, output->written + (uint64_t)count, __ATOMIC_RELEASE);
}

void output_start(Output *output, double rate) {
    output->rate = rate;
    output->start_ns = now_ns();
    output->streams = 1;
}

void output_end(Output *output) {
    const double *queue = (const double *)((const char *)output + DATA_OFFSET);
    if (output->written > 0) {
        uint64_t last = output->written - 1, now = (uint64_t)((double)(now_ns() - output->start_ns) * 1e-9 * output->rate);
        output->volts[output->target] = queue[(now < last ? now : last) % STANDIN_QUEUE];
    }
    output->streams = 0;
}

static double option(const char *specification, const char *name, double fallback) {
    const char *at = strstr(specification, name);
    return at == NULL ? fallback : atof(at + strlen(name));
}

int source_open(Source *source, const char *specification) {
    memset(source, 0, sizeof *source);
    const char *text = specification != NULL ? specification : "sine";
    if (strncmp(text, "feed:", 5) == 0) {
        source->kind = SOURCE_FEED;
        source->feed = map_file(text + 5, "ATPIDFD1", &source->feed_size);
        return source->feed == NULL ? -1 : 0;
    }
    source->kind = strncmp(text, "ramp", 4) == 0 ? SOURCE_RAMP : SOURCE_SINE;
    source->amplitude = option(text, "amplitude=", 1.0);
    source->offset = option(text, "offset=", 3.0);
    source->frequency = option(text, "frequency=", 5.0);
    source->common = option(text, "common=", 0.0);
    return 0;
}

void source_close(Source *source) {
    if (source->feed != NULL) munmap((void *)(uintptr_t)source->feed, source->feed_size);
    source->feed = NULL;
}

static uint64_t feed_written(const Source *source) { return __atomic_load_n(&source->feed->written, __ATOMIC_ACQUIRE); }

void stream_start(Stream *stream) {
    stream->start_ns = now_ns();
    stream->next = stream->moved = stream->generated = 0;
    stream->lost = 0;
    stream->drop_taken = stream->control->drop;
    stream->unplugs = stream->control->unplugs;
    stream->fails = stream->control->fail_count;
    if (stream->source.kind == SOURCE_FEED) stream->source.feed_start = feed_written(&stream->source);
}

/* Scan i lies at frame feed_start + i feed_rate / rate; it exists once both its neighbours have been written. */
static uint64_t feed_scans(const Stream *stream) {
    const Feed *feed = stream->source.feed;
    double reach = (stream->channels - 1) * stream->skew * feed->rate + 1.0;
    double frames = (double)(feed_written(&stream->source) - stream->source.feed_start) - reach;
    return frames <= 0 ? 0 : (uint64_t)floor(frames * stream->rate / feed->rate) + 1;
}

static uint64_t clock_scans(const Stream *stream) {
    double seconds = (double)(now_ns() - stream->start_ns) * 1e-9;
    return (uint64_t)(seconds * (1.0 - stream->control->slow) * stream->rate);
}

static void lose(Stream *stream, uint64_t from, uint64_t to) {
    if (stream->lost == STANDIN_MAX_LOST) {
        memmove(stream->lost_from, stream->lost_from + 1, sizeof stream->lost_from - sizeof stream->lost_from[0]);
        memmove(stream->lost_to, stream->lost_to + 1, sizeof stream->lost_to - sizeof stream->lost_to[0]);
        stream->lost--;
    }
    stream->lost_from[stream->lost] = from;
    stream->lost_to[stream->lost++] = to;
}

/* Brings the stream up to now: what the device took, what reached the host, what its buffer could not hold. */
void stream_pump(Stream *stream) {
    const Control *control = stream->control;
    stream->generated = stream->source.kind == SOURCE_FEED ? feed_scans(stream) : clock_scans(stream);
    if (control->drop > stream->drop_taken) {
        lose(stream, stream->moved, stream->moved + (control->drop - stream->drop_taken));
        stream->drop_taken = control->drop;
    }
    if (control->stalled) return;
    if (stream->generated > stream->moved + stream->device_capacity) {
        lose(stream, stream->moved + stream->device_capacity, stream->generated);
    }
    stream->moved = stream->generated;
}

static Wait fault(Stream *stream) {
    const Control *control = stream->control;
    if (!control->plugged || control->unplugs != stream->unplugs) return WAIT_UNPLUGGED;
    if (control->fail_count != stream->fails) {
        stream->fails = control->fail_count;
        stream->fail_code = control->fail_code;
        return WAIT_FAILED;
    }
    return stream->moved - stream->next > stream->host_capacity ? WAIT_FULL : WAIT_OK;
}

Wait stream_wait(Stream *stream, uint64_t scans, double timeout_s) {
    int64_t deadline = now_ns() + (int64_t)(timeout_s * 1e9);
    for (;;) {
        stream_pump(stream);
        Wait state = fault(stream);
        if (state != WAIT_OK) return state;
        if (stream->moved >= stream->next + scans) return WAIT_OK;
        int64_t left = deadline - now_ns();
        if (left <= 0) return WAIT_TIMEOUT;
        int64_t missing = (int64_t)((double)(stream->next + scans - stream->moved) / stream->rate * 1e9) + 50000;
        int64_t sleep = missing < SLICE_NS ? missing : SLICE_NS;
        if (sleep > left) sleep = left;
        nanosleep(&(struct timespec){.tv_nsec = sleep}, NULL);
    }
}

static double feed_value(const Stream *stream, double seconds, int channel, double lost_value) {
    const Feed *feed = stream->source.feed;
    const double *frames = (const double *)((const char *)feed + DATA_OFFSET);
    double position = (double)stream->source.feed_start + seconds * feed->rate;
    uint64_t frame = (uint64_t)floor(position + 1e-9);
    double part = position - (double)frame;
    if (feed_written(&stream->source) > frame + feed->capacity) return lost_value; /* overwritten before it was read */
    if (channel >= (int)feed->channels) return 0.0;
    double here = frames[(frame % feed->capacity) * feed->channels + (unsigned)channel];
    if (part < 1e-9) return here;
    double after = frames[((frame + 1) % feed->capacity) * feed->channels + (unsigned)channel];
    return here + part * (after - here);
}

static double value(const Stream *stream, uint64_t scan, int channel, double lost_value) {
    const Source *source = &stream->source;
    double seconds = (double)scan / stream->rate + channel * stream->skew;
    if (source->kind == SOURCE_FEED) return feed_value(stream, seconds, channel, lost_value);
    if (source->kind == SOURCE_RAMP) return 1.0 + (double)(scan % 4096) / 1024.0;
    seconds = seconds / (1.0 - stream->control->slow) + source->common * 1e-9 * (double)stream->start_ns;
    return source->offset + source->amplitude * sin(2.0 * M_PI * source->frequency * seconds + channel * M_PI / 4.0);
}

static int is_lost(const Stream *stream, uint64_t scan) {
    for (int i = 0; i < stream->lost; i++) {
        if (scan >= stream->lost_from[i] && scan < stream->lost_to[i]) return 1;
    }
    return 0;
}

void stream_copy(Stream *stream, uint64_t scans, double *rows, double lost_value) {
    for (uint64_t i = 0; i < scans; i++) {
        int lost = is_lost(stream, stream->next + i);
        for (int c = 0; c < stream->channels; c++) {
            int held = stream->control->held >> c & 1;
            double volts = held ? stream->control->hold_volts[c] : value(stream, stream->next + i, c, lost_value);
            *rows++ = lost ? lost_value : volts;
        }
    }
    stream->next += scans;
}
