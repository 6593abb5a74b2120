// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// What each command does, and the sequence rule: echoed, an old one refused, a repeated one answered but not done again. Pure.
#pragma once
#include "frame.h"
#include "motion.h"

struct Board {  // what the identity reply contains
    uint32_t boots;
    const char *reset_cause;
};

class Session {
public:
    Session(Motion &motion, const Board &board) : motion_(motion), board_(board) {}
    // Carries `request` out and writes the answer.
    void answer(const Request &request, uint16_t rejected, FrameWriter &reply);

private:
    Motion &motion_;
    const Board &board_;
    bool open_ = false;
    uint16_t last_ = 0;

    const char *refuse(const Request &request);
    const char *act(const Request &request);
    const char *look_up(const Request &request);
    void write_identity(FrameWriter &reply) const;
    void write_state(uint16_t rejected, FrameWriter &reply) const;
};
