// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// Normally closed contacts: an open one counts after DEBOUNCE_MS of being open without a break, and as long again to close. Pure.
#pragma once
#include <stdint.h>

#include "config.h"

class Contact {
public:
    void update(bool open) {
        if (open == open_) {
            count_ = 0;
        } else if (++count_ >= DEBOUNCE_MS) {
            open_ = open;
            count_ = 0;
        }
    }
    bool open() const { return open_; }

private:
    bool open_ = false;
    uint8_t count_ = 0;
};
