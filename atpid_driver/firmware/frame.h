// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// Frames `$<seq>,<WORD>[,<number>]*<CRC16>\n`: a parser of fixed length that accepts nothing doubtful, and a writer. Pure.
#pragma once
#include <stdint.h>

uint16_t crc16(uint16_t crc, uint8_t byte);  // XMODEM

struct Request {
    uint16_t sequence;
    char word[8];
    bool has_number;
    uint32_t number;
};

class FrameParser {
public:
    // Takes one byte; true when it completed a frame with a right check sum and form, which is then in `request`.
    bool take(uint8_t byte, Request &request);
    uint16_t rejected() const { return rejected_; }  // frames begun and refused, modulo 65536

private:
    static constexpr uint8_t SIZE = 32;  // longest frame without `$` and line end
    char buffer_[SIZE];
    uint8_t length_ = 0;
    bool inside_ = false;
    uint16_t rejected_ = 0;

    bool finish(Request &request);
    void reject();
};

class FrameWriter {
public:
    FrameWriter();
    void text(const char *characters);
    void comma() { put(','); }
    void number(uint32_t value);
    void micrometres(bool known, int32_t value);  // "-" where it is not known
    void hexadecimal(uint16_t value);
    const char *finish();  // adds check sum and line end; the frame, terminated
    uint8_t length() const { return length_; }

private:
    static constexpr uint8_t SIZE = 97;
    char buffer_[SIZE];
    uint8_t length_ = 0;
    uint16_t crc_ = 0;

    void put(char character);
    void raw(char character);
    void digits(uint16_t value, bool counted);
};
