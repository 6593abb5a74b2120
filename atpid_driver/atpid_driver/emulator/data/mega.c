// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "mega.h"

#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Data addresses of the ATmega2560. */
enum { PINA = 0x20, DDRA = 0x21, PORTA = 0x22, MCUSR = 0x54, WDTCSR = 0x60 };
enum { PORF = 1, EXTRF = 2, WDRF = 8, WDIF = 0x80 };
enum { BIT_ENABLE = 0, BIT_UP = 1, BIT_LOWER = 2, BIT_UPPER = 3, BIT_STOP = 4 };
enum { EEPROM_SIZE = 4096, HANG_ADDRESS = 0x30000, JUMP_TO_ITSELF = 0xCFFF };
enum { WATCHDOG_HZ = 128000, LONGEST_SERVICE = 10000 /* instructions */ };

int queue_put(struct queue *queue, uint8_t byte) {
    if (queue->count == QUEUE) return 0;
    queue->bytes[(queue->head + queue->count++) % QUEUE] = byte;
    return 1;
}

int queue_take(struct queue *queue) {
    if (!queue->count) return -1;
    uint8_t byte = queue->bytes[queue->head];
    queue->head = (queue->head + 1) % QUEUE;
    --queue->count;
    return byte;
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { /* simulated time passes, not ours */
    (void)avr;
    (void)cycles;
}

static void log_to_stderr(avr_t *avr, const int level, const char *format, va_list arguments) {
    (void)avr;
    if (level == LOG_ERROR) vfprintf(stderr, format, arguments);
}

static void on_byte(avr_irq_t *irq, uint32_t value, void *param) {
    struct mega *mega = param;
    (void)irq;
    queue_put(&mega->from_board, (uint8_t)value);
}

static void on_pause(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    ((struct mega *)param)->paused = 1;
}

static void on_resume(avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    ((struct mega *)param)->paused = 0;
}

static void on_conversion(avr_irq_t *irq, uint32_t value, void *param) {
    struct mega *mega = param;
    (void)irq;
    (void)value;
    avr_raise_irq(avr_io_getirq(mega->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), stand_millivolts(&mega->stand));
}

static void eeprom_transfer(struct mega *mega, uint32_t direction, uint8_t *bytes) {
    avr_eeprom_desc_t part = {.ee = bytes, .offset = 0, .size = EEPROM_SIZE};
    avr_ioctl(mega->avr, direction, &part);
}

static void eeprom_load(struct mega *mega) {
    static uint8_t bytes[EEPROM_SIZE];
    FILE *file = mega->eeprom ? fopen(mega->eeprom, "rb") : NULL;
    if (!file) return;
    if (fread(bytes, 1, EEPROM_SIZE, file) == EEPROM_SIZE) eeprom_transfer(mega, AVR_IOCTL_EEPROM_SET, bytes);
    fclose(file);
}

static void eeprom_save(struct mega *mega) {
    static uint8_t bytes[EEPROM_SIZE];
    FILE *file = mega->eeprom ? fopen(mega->eeprom, "wb") : NULL;
    if (!file) return;
    eeprom_transfer(mega, AVR_IOCTL_EEPROM_GET, bytes);
    fwrite(bytes, 1, EEPROM_SIZE, file);
    fclose(file);
}

static void restarted(struct mega *mega) {
    ++mega->resets;
    mega->to_board.count = 0;
    mega->paused = 0;
    mega->unserved = 0;
    mega->stuck_until = mega->clock + mega->bootloader;
}

int mega_power_on(struct mega *mega) {
    elf_firmware_t firmware;
    uint32_t flags = 0;
    if (mega->avr) return 1;
    avr_global_logger_set(log_to_stderr); /* standard output carries our answers */
    memset(&firmware, 0, sizeof firmware);
    if (elf_read_firmware(mega->elf, &firmware) != 0) return 0;
    mega->avr = avr_make_mcu_by_name("atmega2560");
    if (!mega->avr) return 0;
    avr_init(mega->avr);
    mega->avr->log = LOG_ERROR;
    mega->avr->frequency = MEGA_HZ;
    firmware.frequency = MEGA_HZ;
    avr_load_firmware(mega->avr, &firmware);
    mega->avr->vcc = mega->avr->avcc = mega->avr->aref = 5000;
    mega->avr->sleep = no_sleep;
    mega->avr->codeend = mega->avr->flashend;
    mega->avr->flash[HANG_ADDRESS] = JUMP_TO_ITSELF & 0xFF;
    mega->avr->flash[HANG_ADDRESS + 1] = JUMP_TO_ITSELF >> 8;
    avr_ioctl(mega->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(mega->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, mega);
    avr_irq_register_notify(avr_io_getirq(mega->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_pause, mega);
    avr_irq_register_notify(avr_io_getirq(mega->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_resume, mega);
    avr_irq_register_notify(avr_io_getirq(mega->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_conversion, mega);
    eeprom_load(mega);
    mega->avr->data[MCUSR] = PORF;
    mega->seen = mega->avr->cycle;
    restarted(mega);
    return 1;
}

static void look_at_motor(struct mega *mega) {
    int motor = 0;
    if (mega->avr) {
        uint8_t driven = mega->avr->data[PORTA] & mega->avr->data[DDRA]; /* an input's pull-down keeps the motor off */
        if (driven >> BIT_ENABLE & 1) motor = driven >> BIT_UP & 1 ? 1 : -1;
    }
    if (motor == mega->stand.motor) return;
    if (!motor) mega->motor_off_at = mega->clock;
    mega->stand.motor = motor;
    ++mega->stand.switched;
}

void mega_power_off(struct mega *mega) {
    if (!mega->avr) return;
    eeprom_save(mega);
    avr_terminate(mega->avr);
    mega->avr = NULL;
    look_at_motor(mega);
}

static void reset(struct mega *mega, uint8_t cause) {
    avr_reset(mega->avr);
    mega->avr->data[MCUSR] = cause;
    restarted(mega);
    look_at_motor(mega);
}

void mega_reset(struct mega *mega) {
    if (mega->avr) reset(mega, EXTRF);
}

void mega_hang(struct mega *mega, int interrupts) {
    if (!mega->avr) return;
    /* an interrupt that is being served would not end: what hangs is the main program */
    for (int left = LONGEST_SERVICE; left && !mega->avr->sreg[S_I]; --left) avr_run(mega->avr);
    mega->avr->pc = HANG_ADDRESS;
    if (!interrupts) mega->avr->sreg[S_I] = 0;
}

/* A time-out whose interrupt is not served before the next one restarts the board (data sheet 12.4); simavr 1.6 waits on. */
static void restart_unserved(struct mega *mega) {
    uint8_t control = mega->avr->data[WDTCSR];
    unsigned prescaler = (control & 7u) | (control >> 2 & 8u);
    uint64_t period = (2048ull << prescaler) * MEGA_HZ / WATCHDOG_HZ;
    if (!(control & WDIF)) mega->unserved = 0;
    else if (!mega->unserved) mega->unserved = mega->clock;
    else if (mega->clock - mega->unserved >= period) reset(mega, WDRF);
}

static void show_contacts(struct mega *mega) {
    uint8_t pins = mega->avr->data[PINA] & (uint8_t)~(1u << BIT_LOWER | 1u << BIT_UPPER | 1u << BIT_STOP);
    pins = (uint8_t)(pins | stand_lower_open(&mega->stand) << BIT_LOWER | stand_upper_open(&mega->stand) << BIT_UPPER |
                     stand_stop_open(&mega->stand) << BIT_STOP);
    mega->avr->data[PINA] = pins;
}

static void send_byte(struct mega *mega) {
    int byte = mega->paused ? -1 : queue_take(&mega->to_board);
    if (byte < 0) return;
    avr_raise_irq(avr_io_getirq(mega->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), (uint32_t)byte);
    mega->last_byte_at = mega->clock;
}

/* Runs the processor for one step; simavr starts over at cycle 0 of the program when its watchdog bites. */
static void run_board(struct mega *mega) {
    uint64_t goal = mega->seen + MEGA_STEP;
    int state = cpu_Running;
    avr_flashaddr_t before = mega->avr->pc;
    while (mega->avr->cycle < goal) {
        before = mega->avr->pc;
        state = avr_run(mega->avr);
        if (mega->avr->pc == 0 && before != 0) { /* only a restart comes back to the reset vector */
            mega->clock += mega->avr->cycle > mega->seen ? mega->avr->cycle - mega->seen : 0;
            mega->seen = mega->avr->cycle;
            restarted(mega);
            return;
        }
        if (state == cpu_Done || state == cpu_Crashed) break;
    }
    if (mega->avr->cycle < goal) mega->avr->cycle = goal; /* crashed: time goes on */
    mega->clock += mega->avr->cycle - mega->seen;
    mega->seen = mega->avr->cycle;
}

void mega_run(struct mega *mega, uint64_t cycles) {
    uint64_t end = mega->clock + cycles;
    while (mega->clock < end) {
        uint64_t before = mega->clock;
        if (mega->avr && mega->clock >= mega->stuck_until) {
            show_contacts(mega);
            send_byte(mega);
            run_board(mega);
            restart_unserved(mega);
        } else {
            mega->to_board.count = 0; /* no host */
            mega->clock += MEGA_STEP;
        }
        look_at_motor(mega);
        stand_step(&mega->stand, (double)(mega->clock - before) / MEGA_HZ);
    }
}

const char *mega_state(const struct mega *mega) {
    if (!mega->avr) return "off";
    if (mega->clock < mega->stuck_until) return "bootloader";
    return mega->avr->state == cpu_Crashed ? "crashed" : "running";
}
