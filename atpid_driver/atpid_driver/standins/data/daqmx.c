// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* A stand-in for NI's libnidaqmx.so with one NI-9230 behind it, so that the real nidaqmx package runs without a
 * device. It has the calls of continuous analogue input and output tasks, its outputs as of an NI-9263. Environment: ATPID_DAQMX_SOURCE
 * (sine[:amplitude=,offset=,frequency=] | ramp | feed:PATH), ATPID_DAQMX_CONTROL (see device.py) and
 * ATPID_DAQMX_DEVICE (name, default cDAQ1Mod1).
 */
#include "standin.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    INVALID_TASK = -200088, BAD_RATE = -200077, NO_CHANNEL = -200170, NO_DEVICE = -200220, UNREACHABLE = -201003,
    OVERWRITTEN = -200279, NOT_YET = -200284, NOT_STARTED = -200983, BAD_ATTRIBUTE = -200233, NO_PROPERTY = -200452,
};
#define TASKS 8
#define MODULE_INPUTS 3
#define MOST_RATE 12800.0
#define STANDARD_GRAVITY 9.80665
#define UNITS_G 10186
#define UNITS_METERS_PER_SECOND_SQUARED 12470
#define SENSITIVITY_VOLTS_PER_G 12510
#define GROUP_BY_CHANNEL 0
#define READ_ALL (-1)

typedef struct {
    int used, running, inputs[STANDIN_MAX_CHANNELS];
    char name[64];
    double scale[STANDIN_MAX_CHANNELS]; /* reading for one volt */
    double most[STANDIN_MAX_CHANNELS];  /* full scale, in the reading's unit */
    unsigned long long buffer;
    double rate;
    Stream stream;
    Output *output; /* of an output task, else NULL */
} Task;

static Task tasks[TASKS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static __thread char detail[256];

static int fail(int code, const char *text) {
    snprintf(detail, sizeof detail, "%s\n\nStatus Code: %d", text, code);
    return code;
}

static const char *text_of(int code) {
    switch (code) {
        case INVALID_TASK: return "Task specified is invalid or does not exist.";
        case BAD_RATE: return "Requested value is not a supported value for this property.";
        case NO_CHANNEL: return "Physical channel specified does not exist on this device.";
        case NO_DEVICE: return "Device identifier is invalid.";
        case UNREACHABLE: return "Device cannot be accessed. Possible causes: it is no longer present or powered.";
        case OVERWRITTEN: return "The application is not able to keep up with the hardware acquisition.";
        case NOT_YET: return "Some or all of the samples requested have not yet been acquired.";
        default: return "Error of the NI-DAQmx stand-in.";
    }
}

static int refuse(int code) { return fail(code, text_of(code)); }

static Task *task_of(void *handle) {
    Task *task = handle;
    return task >= tasks && task < tasks + TASKS && task->used ? task : NULL;
}

static const char *device_name(void) {
    const char *name = getenv("ATPID_DAQMX_DEVICE");
    return name != NULL && *name != 0 ? name : "cDAQ1Mod1";
}

static int text_attribute(const char *text, char *value, unsigned size) {
    if (size == 0) return (int)strlen(text) + 1;
    snprintf(value, size, "%s", text);
    return 0;
}

int DAQmxSetRuntimeEnvironment(const char *a, const char *b, const char *c, const char *d) {
    (void)a, (void)b, (void)c, (void)d;
    return 0;
}

int DAQmxGetSystemInfoAttribute(int attribute, unsigned *value) {
    *value = attribute == 0x1272 ? 24 : attribute == 0x1923 ? 8 : 0;
    return 0;
}

int DAQmxGetDeviceAttribute(const char *device, int attribute, void *value, unsigned size) {
    const Control *control = control_open("ATPID_DAQMX_CONTROL");
    if (strcmp(device, device_name()) != 0) return refuse(NO_DEVICE);
    if (!control->plugged) return refuse(UNREACHABLE);
    if (attribute == 0x631) return text_attribute("NI 9230", value, size);
    if (attribute != 0x632) return refuse(BAD_ATTRIBUTE);
    *(unsigned *)value = control->serial;
    return 0;
}

int DAQmxCreateTask(const char *name, void **handle) {
    pthread_mutex_lock(&lock);
    for (int i = 0; i < TASKS; i++) {
        Task *task = &tasks[i];
        if (task->used) continue;
        memset(task, 0, sizeof *task);
        task->used = 1;
        snprintf(task->name, sizeof task->name, "%s", name);
        if (*name == 0) snprintf(task->name, sizeof task->name, "_unnamedTask<%d>", i);
        task->stream.control = control_open("ATPID_DAQMX_CONTROL");
        *handle = task;
        pthread_mutex_unlock(&lock);
        return 0;
    }
    pthread_mutex_unlock(&lock);
    return refuse(INVALID_TASK);
}

int DAQmxClearTask(void *handle) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    source_close(&task->stream.source);
    if (task->output != NULL && task->running) output_end(task->output);
    task->used = task->running = 0;
    return 0;
}

/* "cDAQ1Mod1/ai0" or a list of them with commas. */
static int add_channels(Task *task, const char *physical, double scale, double most) {
    char list[256], *rest = list;
    snprintf(list, sizeof list, "%s", physical);
    for (char *one = strtok_r(list, ", ", &rest); one != NULL; one = strtok_r(NULL, ", ", &rest)) {
        char *slash = strchr(one, '/');
        if (slash == NULL) return refuse(NO_CHANNEL);
        *slash = 0;
        if (strcmp(one, device_name()) != 0) return refuse(NO_DEVICE);
        if (!task->stream.control->plugged) return refuse(UNREACHABLE);
        int input = strncmp(slash + 1, "ai", 2) == 0 && slash[3] >= '0' && slash[3] <= '9' ? atoi(slash + 3) : -1;
        if (input < 0 || input >= MODULE_INPUTS || task->stream.channels == STANDIN_MAX_CHANNELS) return refuse(NO_CHANNEL);
        task->scale[task->stream.channels] = scale;
        task->most[task->stream.channels] = most;
        task->inputs[task->stream.channels++] = input;
    }
    return 0;
}

int DAQmxCreateAIVoltageChan(void *handle, const char *physical, const char *name, int terminal, double least,
                             double most, int units, const char *scale) {
    (void)name, (void)terminal, (void)least, (void)units, (void)scale;
    Task *task = task_of(handle);
    return task == NULL ? refuse(INVALID_TASK) : add_channels(task, physical, 1.0, most);
}

int DAQmxCreateAIAccelChan(void *handle, const char *physical, const char *name, int terminal, double least,
                           double most, int units, double sensitivity, int sensitivity_units, int excitation,
                           double current, const char *scale) {
    (void)name, (void)terminal, (void)least, (void)excitation, (void)current, (void)scale;
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (!(sensitivity > 0.0)) return refuse(BAD_RATE);
    double g = 1.0 / (sensitivity_units == SENSITIVITY_VOLTS_PER_G ? sensitivity : sensitivity * 1e-3);
    return add_channels(task, physical, units == UNITS_METERS_PER_SECOND_SQUARED ? g * STANDARD_GRAVITY : g, most);
}

int DAQmxCreateAOVoltageChan(void *handle, const char *physical, const char *name, double least, double most,
                             int units, const char *scale) {
    (void)name, (void)least, (void)units, (void)scale;
    Task *task = task_of(handle);
    size_t length = strlen(device_name());
    if (task == NULL) return refuse(INVALID_TASK);
    if (strncmp(physical, device_name(), length) != 0) return refuse(NO_DEVICE);
    if (!task->stream.control->plugged) return refuse(UNREACHABLE);
    if (strcmp(physical + length, "/ao0") != 0 && strcmp(physical + length, "/ao1") != 0) return refuse(NO_CHANNEL);
    task->output = output_open("ATPID_DAQMX_OUTPUT");
    if (task->output == NULL) return refuse(UNREACHABLE);
    task->output->target = physical[length + 3] == '1';
    task->most[0] = most;
    task->stream.channels = 1;
    return 0;
}

int DAQmxSetWriteAttribute(void *handle, int attribute, int value) {
    (void)attribute, (void)value;
    return task_of(handle) == NULL ? refuse(INVALID_TASK) : 0;
}

int DAQmxWriteAnalogF64(void *handle, int samples, unsigned start, double timeout, int fill, const double *volts,
                        int *written, void *reserved) {
    (void)start, (void)timeout, (void)fill, (void)reserved;
    Task *task = task_of(handle);
    if (task == NULL || task->output == NULL) return refuse(INVALID_TASK);
    if (!task->stream.control->plugged) return refuse(UNREACHABLE);
    output_write(task->output, volts, samples);
    *written = samples;
    return 0;
}

int DAQmxWriteAnalogScalarF64(void *handle, unsigned start, double timeout, double volts, void *reserved) {
    (void)start, (void)timeout, (void)reserved;
    Task *task = task_of(handle);
    if (task == NULL || task->output == NULL) return refuse(INVALID_TASK);
    if (!task->stream.control->plugged) return refuse(UNREACHABLE);
    task->output->streams = 0; /* also that of a process that was killed */
    task->output->volts[task->output->target] = volts;
    return 0;
}

int DAQmxCfgSampClkTiming(void *handle, const char *source, double rate, int edge, int mode, unsigned long long samples) {
    (void)source, (void)edge, (void)mode;
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (task->output != NULL) {
        task->rate = rate;
        task->output->written = 0;
        return 0;
    }
    if (!(rate > 0.0) || rate > MOST_RATE * (1.0 + 1e-9)) return refuse(BAD_RATE);
    task->rate = MOST_RATE / floor(MOST_RATE / rate * (1.0 + 1e-12)); /* 12.8 kS/s / n, coerced up */
    unsigned long long least = task->rate <= 100.0 ? 1000 : task->rate <= 10000.0 ? 10000 : 100000;
    task->buffer = samples > least ? samples : least;
    return 0;
}

int DAQmxGetTimingAttribute(void *handle, int attribute, double *value) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (attribute != 0x1344) return refuse(BAD_ATTRIBUTE);
    *value = task->rate;
    return 0;
}

int DAQmxGetTaskAttribute(void *handle, int attribute, void *value, unsigned size) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (attribute == 0x1276) return text_attribute(task->name, value, size);
    if (attribute == 0x1273) {
        char names[256] = "";
        for (int i = 0; i < task->stream.channels; i++) {
            size_t used = strlen(names);
            snprintf(names + used, sizeof names - used, "%s%s/ai%d", i > 0 ? ", " : "", device_name(), task->inputs[i]);
        }
        return text_attribute(names, value, size);
    }
    *(unsigned *)value = attribute == 0x2181 ? (unsigned)task->stream.channels : attribute == 0x230e;
    return 0;
}

int DAQmxGetChanAttribute(void *handle, const char *channel, int attribute, void *value) {
    (void)channel;
    if (task_of(handle) == NULL) return refuse(INVALID_TASK);
    if (attribute != 0x0695) return refuse(BAD_ATTRIBUTE);
    *(int *)value = 10356; /* accelerometer */
    return 0;
}

int DAQmxStartTask(void *handle) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    Stream *stream = &task->stream;
    if (!stream->control->plugged) return refuse(UNREACHABLE);
    if (task->output != NULL) {
        output_start(task->output, task->rate);
        task->running = 1;
        return 0;
    }
    source_close(&stream->source);
    if (source_open(&stream->source, getenv("ATPID_DAQMX_SOURCE")) != 0) return refuse(UNREACHABLE);
    stream->rate = task->rate;
    stream->skew = 0.0; /* one converter a channel */
    stream->host_capacity = task->buffer;
    stream->device_capacity = 1000000;
    stream_start(stream);
    task->running = 1;
    return 0;
}

int DAQmxStopTask(void *handle) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    task->running = 0;
    return task->stream.control->plugged ? 0 : refuse(UNREACHABLE);
}

int DAQmxGetReadAttribute(void *handle, int attribute, void *value, unsigned size) {
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (attribute == 0x217b) {
        *(unsigned *)value = (unsigned)task->stream.channels;
        return 0;
    }
    if (attribute == 0x1223) {
        if (task->running) stream_pump(&task->stream);
        *(unsigned *)value = (unsigned)(task->stream.moved - task->stream.next);
        return 0;
    }
    return attribute == 0x1227 ? DAQmxGetTaskAttribute(handle, 0x1273, value, size) : refuse(BAD_ATTRIBUTE);
}

static void arrange(Task *task, unsigned scans, int fill, double *out) {
    double row[STANDIN_MAX_CHANNELS];
    int channels = task->stream.channels;
    for (unsigned i = 0; i < scans; i++) {
        stream_copy(&task->stream, 1, row, NAN);
        for (int c = 0; c < channels; c++) {
            double reading = row[c] * task->scale[c];
            double bounded = fmax(-task->most[c], fmin(task->most[c], reading));
            size_t at = fill == GROUP_BY_CHANNEL ? (size_t)c * scans + i : (size_t)i * (unsigned)channels + (unsigned)c;
            out[at] = isnan(reading) ? NAN : bounded;
        }
    }
}

int DAQmxReadAnalogF64(void *handle, int samples, double timeout, int fill, double *out, unsigned size, int *read, void *reserved) {
    (void)reserved;
    *read = 0;
    Task *task = task_of(handle);
    if (task == NULL) return refuse(INVALID_TASK);
    if (!task->running) return refuse(NOT_STARTED);
    Stream *stream = &task->stream;
    if (samples == READ_ALL) {
        stream_pump(stream);
        samples = (int)(stream->moved - stream->next);
    }
    if ((unsigned)samples * (unsigned)stream->channels > size) return refuse(NO_PROPERTY);
    Wait wait = stream_wait(stream, (uint64_t)samples, timeout < 0.0 ? 1e9 : timeout);
    if (wait == WAIT_UNPLUGGED) return refuse(UNREACHABLE);
    if (wait == WAIT_FULL) return refuse(OVERWRITTEN);
    if (wait == WAIT_FAILED) return refuse(stream->fail_code);
    if (wait == WAIT_TIMEOUT) samples = (int)(stream->moved - stream->next);
    arrange(task, (unsigned)samples, fill, out);
    *read = samples;
    return wait == WAIT_TIMEOUT ? refuse(NOT_YET) : 0;
}

int DAQmxGetErrorString(int code, char *text, unsigned size) {
    snprintf(text, size, "%s", text_of(code));
    return 0;
}

int DAQmxGetExtendedErrorInfo(char *text, unsigned size) {
    snprintf(text, size, "%s", detail);
    return 0;
}
