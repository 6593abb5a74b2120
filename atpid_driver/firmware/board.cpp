// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "board.h"

#include <Arduino.h>
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

namespace {

constexpr uint8_t CONVERSIONS = 16;  // per sum
volatile uint16_t latest_sum;
volatile uint8_t sums;
uint8_t reset_flags __attribute__((section(".noinit")));

// The boot counter lives in two slots written in turn, so that a power cut while writing loses one count, not all.
struct Slot {
    uint32_t boots;
    uint16_t check;
};
Slot slots[2] EEMEM;

constexpr uint8_t LATCHED = 0x57;  // any other value, as in an empty cell: not latched
uint8_t watchdog_latch EEMEM;
bool watchdog_latched;

uint16_t check_of(uint32_t boots) {
    uint16_t crc = 0x4154;  // so that an empty or zeroed cell is not a valid slot
    for (uint8_t shift = 0; shift < 32; shift = static_cast<uint8_t>(shift + 8)) crc = crc16(crc, static_cast<uint8_t>(boots >> shift));
    return crc;
}

uint32_t slot_boots(uint8_t index) {
    Slot slot;
    eeprom_read_block(&slot, &slots[index], sizeof slot);
    return slot.check == check_of(slot.boots) ? slot.boots : 0;
}

uint32_t count_boot() {
    const uint32_t even = slot_boots(0), odd = slot_boots(1);
    const uint32_t boots = (even > odd ? even : odd) + 1;
    const Slot slot = {boots, check_of(boots)};
    eeprom_update_block(&slot, &slots[boots & 1], sizeof slot);
    return boots;
}

const char *reset_cause() {
    if (reset_flags & _BV(WDRF)) return "WATCHDOG";
    if (reset_flags & _BV(BORF)) return "BROWNOUT";
    if (reset_flags & _BV(EXTRF)) return "RESET";
    if (reset_flags & _BV(PORF)) return "POWER";
    return "UNKNOWN";  // a bootloader may have cleared the flags
}

}  // namespace

// Before main: after a watchdog reset the watchdog is still running at its shortest time.
extern "C" void keep_reset_flags() __attribute__((naked, used, section(".init3")));
extern "C" void keep_reset_flags() {
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

// The first time-out of a hung program: motor off, and the cause kept where no reset and no bootloader clears it.
// A program that hangs with interrupts off is restarted by the second time-out (data sheet 12.4).
ISR(WDT_vect) {
    board_drive(Direction::OFF);
    board_latch_watchdog(true);
    wdt_enable(WDTO_15MS);
    for (;;) {
    }
}

ISR(ADC_vect) {
    static uint16_t sum = 0;
    static uint8_t count = 0;
    sum = static_cast<uint16_t>(sum + ADC);
    if (++count == CONVERSIONS) {
        latest_sum = sum;
        sums = static_cast<uint8_t>(sums + 1);
        sum = count = 0;
    }
    ADCSRA |= _BV(ADSC);
}

void board_begin() {
    digitalWrite(PIN_ENABLE, LOW);
    pinMode(PIN_ENABLE, OUTPUT);
    digitalWrite(PIN_UP, LOW);
    pinMode(PIN_UP, OUTPUT);
    const uint8_t contacts[] = {PIN_LOWER, PIN_UPPER, PIN_STOP};
    for (const uint8_t pin : contacts) pinMode(pin, INPUT_PULLUP);
    watchdog_latched = eeprom_read_byte(&watchdog_latch) == LATCHED;
    if (reset_flags & _BV(WDRF)) board_latch_watchdog(true);
    wdt_enable(WDTO_120MS);
    WDTCSR |= _BV(WDIE);  // interrupt at the first time-out, restart at the second
    ADMUX = static_cast<uint8_t>(_BV(REFS0) | ADC_CHANNEL);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);  // 125 kHz: 9600 conversions/s
    set_sleep_mode(SLEEP_MODE_IDLE);
}

Board board_describe() { return Board{count_boot(), reset_cause()}; }

bool board_watchdog_latched() { return watchdog_latched; }

void board_latch_watchdog(bool latched) {
    if (latched == watchdog_latched) return;
    watchdog_latched = latched;
    eeprom_update_byte(&watchdog_latch, latched ? LATCHED : 0);
}

Inputs board_inputs(uint32_t now_ms) {
    Inputs inputs;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        inputs.raw = latest_sum;
        inputs.count = sums;
    }
    inputs.now_ms = now_ms;
    inputs.lower_open = digitalRead(PIN_LOWER) == HIGH;
    inputs.upper_open = digitalRead(PIN_UPPER) == HIGH;
    inputs.stop_open = digitalRead(PIN_STOP) == HIGH;
    return inputs;
}

void board_drive(Direction direction) {
    if (direction == Direction::OFF) {
        digitalWrite(PIN_ENABLE, LOW);
        return;
    }
    digitalWrite(PIN_UP, direction == Direction::UP ? HIGH : LOW);
    digitalWrite(PIN_ENABLE, HIGH);
}

void board_alive() { wdt_reset(); }

void board_rest() { sleep_mode(); }
