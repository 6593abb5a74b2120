// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "frame.h"

#ifdef __AVR__
#include <util/crc16.h>
uint16_t crc16(uint16_t crc, uint8_t byte) { return _crc_xmodem_update(crc, byte); }
#else
uint16_t crc16(uint16_t crc, uint8_t byte) {
    crc ^= static_cast<uint16_t>(byte << 8);
    for (uint8_t bit = 0; bit < 8; ++bit) crc = static_cast<uint16_t>((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
    return crc;
}
#endif

namespace {

constexpr uint8_t CHECK_LENGTH = 5;  // '*' and four digits

int8_t hex_digit(char c) {
    if (c >= '0' && c <= '9') return static_cast<int8_t>(c - '0');
    if (c >= 'A' && c <= 'F') return static_cast<int8_t>(c - 'A' + 10);
    return -1;
}

// Reads a whole number without sign or leading zero; moves `at` past it. False if there is none or it exceeds `highest`.
bool read_number(const char *text, uint8_t end, uint8_t &at, uint32_t highest, uint32_t &value) {
    const uint8_t start = at;
    value = 0;
    while (at < end && text[at] >= '0' && text[at] <= '9') {
        if (at - start >= 8) return false;
        value = value * 10 + static_cast<uint32_t>(text[at++] - '0');
    }
    const bool leading_zero = at - start > 1 && text[start] == '0';
    return at > start && !leading_zero && value <= highest;
}

// Reads a word of capital letters into `word`; moves `at` past it.
bool read_word(const char *text, uint8_t end, uint8_t &at, char (&word)[8]) {
    uint8_t length = 0;
    while (at < end && text[at] >= 'A' && text[at] <= 'Z') {
        if (length == sizeof word - 1) return false;
        word[length++] = text[at++];
    }
    word[length] = '\0';
    return length > 0;
}

bool check_sum_right(const char *text, uint8_t length) {
    const uint8_t star = static_cast<uint8_t>(length - CHECK_LENGTH);
    if (text[star] != '*') return false;
    uint16_t computed = 0, given = 0;
    for (uint8_t i = 0; i < star; ++i) computed = crc16(computed, static_cast<uint8_t>(text[i]));
    for (uint8_t i = static_cast<uint8_t>(star + 1); i < length; ++i) {
        const int8_t digit = hex_digit(text[i]);
        if (digit < 0) return false;
        given = static_cast<uint16_t>(given << 4 | static_cast<uint8_t>(digit));
    }
    return computed == given;
}

}  // namespace

bool FrameParser::take(uint8_t byte, Request &request) {
    if (byte == '$') {
        if (inside_) reject();
        inside_ = true;
        length_ = 0;
        return false;
    }
    if (!inside_) return false;
    if (byte == '\n') return finish(request);
    if (byte < ' ' || byte > '~' || length_ == SIZE) {
        reject();
        return false;
    }
    buffer_[length_++] = static_cast<char>(byte);
    return false;
}

bool FrameParser::finish(Request &request) {
    uint8_t at = 0;
    uint32_t sequence = 0;
    const uint8_t end = length_ > CHECK_LENGTH ? static_cast<uint8_t>(length_ - CHECK_LENGTH) : 0;
    bool good = end > 0 && check_sum_right(buffer_, length_) && read_number(buffer_, end, at, 0xFFFF, sequence) &&
                at < end && buffer_[at++] == ',' && read_word(buffer_, end, at, request.word);
    request.has_number = good && at < end;
    if (request.has_number) {
        good = buffer_[at++] == ',' && read_number(buffer_, end, at, 99999999, request.number) && at == end;
    }
    if (!good) {
        reject();
        return false;
    }
    request.sequence = static_cast<uint16_t>(sequence);
    inside_ = false;
    return true;
}

void FrameParser::reject() {
    inside_ = false;
    ++rejected_;
}

FrameWriter::FrameWriter() { raw('$'); }

void FrameWriter::raw(char character) {
    if (length_ < SIZE - 1) buffer_[length_++] = character;
}

void FrameWriter::put(char character) {
    crc_ = crc16(crc_, static_cast<uint8_t>(character));
    raw(character);
}

void FrameWriter::text(const char *characters) {
    while (*characters) put(*characters++);
}

void FrameWriter::number(uint32_t value) {
    char reversed[10];
    uint8_t count = 0;
    do {
        reversed[count++] = static_cast<char>('0' + value % 10);
        value /= 10;
    } while (value);
    while (count) put(reversed[--count]);
}

void FrameWriter::micrometres(bool known, int32_t value) {
    if (!known || value < 0) put('-');
    if (known) number(static_cast<uint32_t>(value < 0 ? -value : value));
}

void FrameWriter::digits(uint16_t value, bool counted) {
    for (int8_t shift = 12; shift >= 0; shift = static_cast<int8_t>(shift - 4)) {
        const char digit = "0123456789ABCDEF"[value >> shift & 0xF];
        counted ? put(digit) : raw(digit);
    }
}

void FrameWriter::hexadecimal(uint16_t value) { digits(value, true); }

const char *FrameWriter::finish() {
    const uint16_t crc = crc_;
    raw('*');
    digits(crc, false);
    raw('\n');
    buffer_[length_] = '\0';
    return buffer_;
}
