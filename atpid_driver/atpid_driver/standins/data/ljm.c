// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
/* A stand-in for LabJack's libLabJackM.so with one T7 behind it, so that the real labjack.ljm package runs without
 * a device. Only the calls that package makes for opening, registers and streaming exist. Environment:
 * ATPID_LJM_SOURCE (sine[:amplitude=,offset=,frequency=] | ramp | feed:PATH), ATPID_LJM_CONTROL (see device.py) and
 * ATPID_LJM_OUTPUT (see device.py).
 */
#include "standin.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    NOT_OPEN = 1224, NOT_FOUND = 1227, RECONNECT_FAILED = 1239, INVALID_ADDRESS = 1250, INVALID_NAME = 1294,
    BUFFER_FULL = 1301, NOT_RUNNING = 1303, SYNCHRONISATION = 1306, NO_SCANS = 1309,
    STREAM_ACTIVE = 2605, CONFIG_INVALID = 2606, NO_BUFFER = 2617, SCAN_OVERLAP = 2942,
};
#define T7 7
#define USB 1
#define DUMMY (-9999.0)
#define BUFFER_SECONDS 20.0 /* kept by LJM while it is not read */
#define HANDLES 8
#define REGISTERS 64

typedef struct {
    int open, streaming, scans_per_read, overlap;
    Control identity; /* serial and number of unplugs at the time of opening */
    Stream stream;
    Output *output;
} Device;

#define STREAM_OUT0 4800
#define SET_DEFAULT_TO_CURRENT 49002

static Device devices[HANDLES];
static struct { char name[48]; double value; } registers[REGISTERS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static Device *device_of(int handle) {
    return handle >= 1 && handle <= HANDLES && devices[handle - 1].open ? &devices[handle - 1] : NULL;
}

static int present(const Device *device) {
    const Control *control = device->stream.control;
    return control->plugged && control->unplugs == device->identity.unplugs;
}

static void feed(Output *output) {
    output->booted = 0;
    __atomic_store_n(&output->fed_ns, now_ns(), __ATOMIC_RELEASE);
}

/* What the watchdog has done since the call before: device.py shows it from the instant on at which it acts. */
static void catch_up(Output *output) {
    uint32_t period = output->booted ? output->watchdog_startup_s : output->watchdog_s;
    if (!output->watchdog || (double)(now_ns() - output->fed_ns) * 1e-9 <= period) return;
    for (int i = 0; i < STANDIN_OUTPUTS; i++) {
        if (output->watchdog_resets) output->volts[i] = output->power_up[i];
        else if (output->watchdog_sets[i]) output->volts[i] = output->watchdog_volts[i];
    }
    if (output->watchdog_resets) output->streams = 0, output->rate = 0.0;
    output->booted = output->watchdog_resets;
    output->fed_ns = now_ns();
}

/* Any call feeds the device's watchdog, unless that is strict. */
static void contact(const Device *device) {
    if (device->output == NULL) return;
    catch_up(device->output);
    if (!device->output->watchdog_strict) feed(device->output);
}

static double register_value(const char *name, double fallback) {
    for (int i = 0; i < REGISTERS; i++) {
        if (strcmp(registers[i].name, name) == 0) return registers[i].value;
    }
    return fallback;
}

/* An address for the registers the driver uses; AIN0.. are 0, 2, 4, ... as on the device. */
static int address_of(const char *name) {
    static const struct { const char *name; int address; } KNOWN[] = {
        {"AIN_ALL_RANGE", 43900}, {"AIN_ALL_NEGATIVE_CH", 43902}, {"STREAM_SETTLING_US", 4008},
        {"STREAM_RESOLUTION_INDEX", 4010}, {"STREAM_BUFFER_SIZE_BYTES", 4012}, {"STREAM_CLOCK_SOURCE", 4014},
        {"STREAM_TRIGGER_INDEX", 4024}, {"SERIAL_NUMBER", 60028}, {"FIRMWARE_VERSION", 60004},
        {"PRODUCT_ID", 60000}, {"STREAM_ENABLE", 4990}, {"DAC0", 1000}, {"DAC1", 1002},
        {"WATCHDOG_ENABLE_DEFAULT", 61600}, {"WATCHDOG_TIMEOUT_S_DEFAULT", 61604},
        {"WATCHDOG_STARTUP_DELAY_S_DEFAULT", 61606}, {"WATCHDOG_STRICT_ENABLE_DEFAULT", 61610},
        {"WATCHDOG_STRICT_KEY_DEFAULT", 61612}, {"WATCHDOG_STRICT_CLEAR", 61614},
        {"WATCHDOG_RESET_ENABLE_DEFAULT", 61620}, {"WATCHDOG_DAC0_ENABLE_DEFAULT", 61640},
        {"WATCHDOG_DAC0_DEFAULT", 61642}, {"WATCHDOG_DAC1_ENABLE_DEFAULT", 61650}, {"WATCHDOG_DAC1_DEFAULT", 61652},
    };
    for (size_t i = 0; i < sizeof KNOWN / sizeof KNOWN[0]; i++) {
        if (strcmp(name, KNOWN[i].name) == 0) return KNOWN[i].address;
    }
    char *end;
    if (strncmp(name, "AIN", 3) != 0 || name[3] < '0' || name[3] > '9') return -1;
    long channel = strtol(name + 3, &end, 10);
    if (channel > 13) return -1;
    if (*end == 0) return (int)channel * 2;
    if (strcmp(end, "_RANGE") == 0) return 40000 + (int)channel * 2;
    if (strcmp(end, "_NEGATIVE_CH") == 0) return 41000 + (int)channel;
    return -1;
}

/* Reads or writes a register of the outputs and their watchdog; 0: it is none. */
static int output_register(Output *output, const char *name, double *value, int write) {
    uint32_t *number = NULL;
    double *volts = NULL;
    int which = strchr(name, '1') != NULL;
    if (output == NULL) return 0;
    if (strcmp(name, "DAC0") == 0 || strcmp(name, "DAC1") == 0) volts = &output->volts[which];
    else if (strcmp(name, "WATCHDOG_ENABLE_DEFAULT") == 0) number = &output->watchdog;
    else if (strcmp(name, "WATCHDOG_TIMEOUT_S_DEFAULT") == 0) number = &output->watchdog_s;
    else if (strcmp(name, "WATCHDOG_STARTUP_DELAY_S_DEFAULT") == 0) number = &output->watchdog_startup_s;
    else if (strcmp(name, "WATCHDOG_STRICT_ENABLE_DEFAULT") == 0) number = &output->watchdog_strict;
    else if (strcmp(name, "WATCHDOG_STRICT_KEY_DEFAULT") == 0) number = &output->watchdog_key;
    else if (strcmp(name, "WATCHDOG_RESET_ENABLE_DEFAULT") == 0) number = &output->watchdog_resets;
    else if (strncmp(name, "WATCHDOG_DAC", 12) != 0) return 0;
    else if (strstr(name, "_ENABLE_") != NULL) number = &output->watchdog_sets[which];
    else volts = &output->watchdog_volts[which];
    if (volts != NULL && write) *volts = *value < 0.0 ? 0.0 : *value > 5.0 ? 5.0 : (double)(float)*value;
    if (number != NULL && write) *number = (uint32_t)*value;
    if (write && strstr(name, "_DEFAULT") != NULL) output->flash++;
    if (write && number == &output->watchdog) feed(output);
    if (!write) *value = volts != NULL ? *volts : (double)*number;
    return 1;
}

int LJM_OpenS(const char *type, const char *connection, const char *identifier, int *handle) {
    (void)type;
    (void)connection;
    const Control *control = control_open("ATPID_LJM_CONTROL");
    const char *source = getenv("ATPID_LJM_SOURCE");
    int any = *identifier == 0 || strcmp(identifier, "ANY") == 0 || strcmp(identifier, "LJM_idANY") == 0;
    if (!control->plugged || (!any && strtoul(identifier, NULL, 10) != control->serial)) return NOT_FOUND;
    pthread_mutex_lock(&lock);
    for (int i = 0; i < HANDLES; i++) {
        Device *device = &devices[i];
        if (device->open && device->stream.control == control) { /* LJM returns one handle for each connection, and restores it */
            if (!present(device)) device->streaming = 0;
            device->identity = *control;
            *handle = i + 1;
            pthread_mutex_unlock(&lock);
            return 0;
        }
    }
    for (int i = 0; i < HANDLES; i++) {
        Device *device = &devices[i];
        if (device->open) continue;
        memset(device, 0, sizeof *device);
        if (source_open(&device->stream.source, source) != 0) break;
        device->open = 1;
        device->identity = *control;
        device->stream.control = control;
        device->output = output_open("ATPID_LJM_OUTPUT");
        contact(device);
        *handle = i + 1;
        pthread_mutex_unlock(&lock);
        return 0;
    }
    pthread_mutex_unlock(&lock);
    return NOT_FOUND;
}

int LJM_Open(int type, int connection, const char *identifier, int *handle) {
    (void)type;
    (void)connection;
    return LJM_OpenS("ANY", "ANY", identifier, handle);
}

int LJM_Close(int handle) {
    Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    source_close(&device->stream.source);
    device->open = device->streaming = 0;
    return 0;
}

int LJM_CloseAll(void) {
    for (int i = 1; i <= HANDLES; i++) LJM_Close(i);
    return 0;
}

int LJM_GetHandleInfo(int handle, int *type, int *connection, int *serial, int *ip, int *port, int *packet) {
    const Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    *type = T7;
    *connection = USB;
    *serial = (int)device->identity.serial;
    *ip = *port = 0;
    *packet = 64;
    return 0;
}

/* Registers of the watchdog that cannot be written while it runs; a real device's error code is not known. */
static int refused(const Output *output, const char *name) {
    return output != NULL && output->watchdog && strncmp(name, "WATCHDOG_", 9) == 0 && strcmp(name, "WATCHDOG_ENABLE_DEFAULT") != 0;
}

int LJM_eWriteName(int handle, const char *name, double value) {
    Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (address_of(name) < 0) return INVALID_NAME;
    contact(device);
    if (device->streaming && strncmp(name, "STREAM_", 7) == 0) return STREAM_ACTIVE;
    if (device->output != NULL && strcmp(name, "WATCHDOG_STRICT_CLEAR") == 0) {
        if (!device->output->watchdog_strict || value == device->output->watchdog_key) feed(device->output);
        return 0;
    }
    if (refused(device->output, name)) return INVALID_ADDRESS;
    if (output_register(device->output, name, &value, 1)) return 0;
    for (int i = 0; i < REGISTERS; i++) {
        if (registers[i].name[0] != 0 && strcmp(registers[i].name, name) != 0) continue;
        snprintf(registers[i].name, sizeof registers[i].name, "%s", name);
        registers[i].value = value;
        return 0;
    }
    return INVALID_NAME;
}

int LJM_eWriteNames(int handle, int count, const char *const *names, const double *values, int *bad) {
    for (int i = 0; i < count; i++) {
        int error = LJM_eWriteName(handle, names[i], values[i]);
        if (error != 0) {
            *bad = address_of(names[i]);
            return error;
        }
    }
    return 0;
}

/* Saves the voltages at power-up; no other register is written by its address. */
int LJM_eWriteAddress(int handle, int address, int type, double value) {
    const Device *device = device_of(handle);
    (void)type;
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (device->output == NULL || address != SET_DEFAULT_TO_CURRENT || value != 1.0) return INVALID_ADDRESS;
    contact(device);
    memcpy(device->output->power_up, device->output->volts, sizeof device->output->volts);
    device->output->flash++;
    return 0;
}

int LJM_eReadName(int handle, const char *name, double *value) {
    const Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (address_of(name) < 0) return INVALID_NAME;
    contact(device);
    if (output_register(device->output, name, value, 0)) return 0;
    int reads_input = strncmp(name, "AIN", 3) == 0 && strchr(name, '_') == NULL;
    if (reads_input && device->streaming) return STREAM_ACTIVE; /* the converter belongs to the stream */
    *value = strcmp(name, "SERIAL_NUMBER") == 0 ? (double)device->identity.serial : register_value(name, 0.0);
    return 0;
}

int LJM_eReadNames(int handle, int count, const char *const *names, double *values, int *bad) {
    for (int i = 0; i < count; i++) {
        int error = LJM_eReadName(handle, names[i], &values[i]);
        if (error != 0) {
            *bad = address_of(names[i]);
            return error;
        }
    }
    return 0;
}

int LJM_NameToAddress(const char *name, int *address, int *type) {
    *address = address_of(name);
    *type = 3;
    return *address < 0 ? INVALID_NAME : 0;
}

int LJM_NamesToAddresses(int count, const char *const *names, int *addresses, int *types) {
    for (int i = 0; i < count; i++) {
        int error = LJM_NameToAddress(names[i], &addresses[i], &types[i]);
        if (error != 0) return error;
    }
    return 0;
}

/* Samples a second at +-10 V, several channels together, by resolution index 1..8 (0 is 1). */
static double most_samples(void) {
    static const double LIMIT[] = {100e3, 100e3, 39.6e3, 19.8e3, 9.8e3, 4.4e3, 2.6e3, 1.3e3, 630.0};
    int index = (int)register_value("STREAM_RESOLUTION_INDEX", 0.0);
    return index < 0 || index > 8 ? 0.0 : LIMIT[index];
}

int LJM_InitializeAperiodicStreamOut(int handle, int index, int target, double rate) {
    const Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (device->output == NULL || index != 0 || (target != 1000 && target != 1002)) return INVALID_ADDRESS;
    device->output->target = target == 1002;
    device->output->rate = rate;
    device->output->written = 0;
    contact(device);
    return 0;
}

int LJM_WriteAperiodicStreamOut(int handle, int index, int count, const double *volts, int *room) {
    const Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (device->output == NULL || index != 0) return INVALID_ADDRESS;
    contact(device);
    if (device->output->rate == 0.0) return NO_BUFFER; /* not since the device has restarted */
    output_write(device->output, volts, count);
    *room = STANDIN_QUEUE - count;
    return 0;
}

int LJM_eStreamStart(int handle, int scans_per_read, int channels, const int *addresses, double *rate) {
    Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!present(device)) return RECONNECT_FAILED;
    if (device->streaming) return STREAM_ACTIVE;
    if (channels < 1 || channels > STANDIN_MAX_CHANNELS || scans_per_read < 1 || !(*rate > 0.0) || most_samples() == 0.0) {
        return CONFIG_INVALID;
    }
    if (device->output != NULL && channels == 1 && addresses[0] == STREAM_OUT0) {
        *rate = 1e7 / round(1e7 / *rate);
        output_start(device->output, *rate);
        device->streaming = 1;
        contact(device);
        return 0;
    }
    for (int i = 0; i < channels; i++) {
        if (addresses[i] < 0 || addresses[i] > 26 || addresses[i] % 2 != 0) return INVALID_ADDRESS;
    }
    Stream *stream = &device->stream;
    *rate = 1e7 / round(1e7 / *rate); /* 80 MHz / 8 / integer */
    stream->rate = *rate;
    stream->channels = channels;
    stream->skew = *rate * channels > 60e3 ? 8e-6 : 15e-6;
    stream->host_capacity = (uint64_t)(BUFFER_SECONDS * *rate) + (uint64_t)scans_per_read;
    stream->device_capacity = (uint64_t)(register_value("STREAM_BUFFER_SIZE_BYTES", 4096.0) / 2.0) / (uint64_t)channels;
    device->overlap = *rate * channels > most_samples() * 1.0001;
    device->scans_per_read = scans_per_read;
    device->streaming = 1;
    stream_start(stream);
    return 0;
}

static int read_error(Device *device, Wait wait) {
    Stream *stream = &device->stream;
    if (device->overlap) return SCAN_OVERLAP;
    switch (wait) {
        case WAIT_UNPLUGGED: return RECONNECT_FAILED;
        case WAIT_FULL: return BUFFER_FULL;
        case WAIT_FAILED: return stream->fail_code;
        case WAIT_TIMEOUT: return stream->moved > stream->next ? SYNCHRONISATION : NO_SCANS;
        default: return 0;
    }
}

int LJM_eStreamRead(int handle, double *data, int *device_backlog, int *host_backlog) {
    Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    if (!device->streaming) return NOT_RUNNING;
    Stream *stream = &device->stream;
    double timeout_s = 1.0 + 2.0 * device->scans_per_read / stream->rate;
    int error = read_error(device, stream_wait(stream, (uint64_t)device->scans_per_read, timeout_s));
    if (error != 0) {
        device->streaming = 0; /* a read error stops the stream */
        return error;
    }
    stream_copy(stream, (uint64_t)device->scans_per_read, data, DUMMY);
    *device_backlog = (int)(stream->generated - stream->moved);
    *host_backlog = (int)(stream->moved - stream->next);
    return 0;
}

int LJM_eStreamStop(int handle) {
    Device *device = device_of(handle);
    if (device == NULL) return NOT_OPEN;
    contact(device);
    int streams_out = device->output != NULL && device->output->streams; /* also that of a process that was killed */
    if (!device->streaming && !streams_out) return NOT_RUNNING;
    device->streaming = 0;
    if (streams_out) output_end(device->output);
    return 0;
}

int LJM_WriteLibraryConfigS(const char *name, double value) {
    (void)name;
    (void)value;
    return 0;
}

void LJM_ErrorToString(int code, char *text) {
    static const struct { int code; const char *text; } NAMES[] = {
        {NOT_OPEN, "LJME_DEVICE_NOT_OPEN"}, {NOT_FOUND, "LJME_DEVICE_NOT_FOUND"},
        {RECONNECT_FAILED, "LJME_RECONNECT_FAILED"}, {INVALID_ADDRESS, "LJME_INVALID_ADDRESS"},
        {INVALID_NAME, "LJME_INVALID_NAME"}, {BUFFER_FULL, "LJME_LJM_BUFFER_FULL"},
        {NOT_RUNNING, "LJME_STREAM_NOT_RUNNING"}, {SYNCHRONISATION, "LJME_SYNCHRONIZATION_TIMEOUT"},
        {NO_SCANS, "LJME_NO_SCANS_RETURNED"}, {STREAM_ACTIVE, "STREAM_IS_ACTIVE"},
        {CONFIG_INVALID, "STREAM_CONFIG_INVALID"}, {NO_BUFFER, "STREAM_OUT_BUFF_DNE"}, {SCAN_OVERLAP, "STREAM_SCAN_OVERLAP"},
    };
    for (size_t i = 0; i < sizeof NAMES / sizeof NAMES[0]; i++) {
        if (NAMES[i].code == code) {
            strcpy(text, NAMES[i].text);
            return;
        }
    }
    snprintf(text, 64, "unknown error %d", code);
}
