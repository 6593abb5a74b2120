// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The one place that decides whether the motor may run. Pure: stepped once a millisecond with what the board sees.
//
// Nothing moves unless armed, without fault, with a fresh heartbeat and (but for homing) homed.
#pragma once
#include <stdint.h>

#include "drive.h"
#include "sensor.h"
#include "switches.h"

enum class Mode : uint8_t { DISARMED = 1, HOMING = 2, HOLDING = 3, MOVING = 4, FAULT = 5 };  // as in CeilingState.msg
enum class Answer : uint8_t { OK, DISARMED, UNHOMED, BUSY, FAULT, RANGE };

struct Inputs {
    uint32_t now_ms;
    uint16_t raw;     // sum of 16 conversions
    uint8_t count;    // of such sums, modulo 256
    bool lower_open;
    bool upper_open;
    bool stop_open;
};

class Motion {
public:
    explicit Motion(uint16_t faults_at_boot = 0);
    void step(const Inputs &inputs);

    Answer arm();
    Answer home();
    Answer move(int32_t target_um);
    Answer stop();
    void disarm();
    void beat() { beat_ms_ = now_ms_; }

    Mode mode() const { return mode_; }
    bool homed() const { return homed_; }
    uint16_t faults() const { return faults_; }
    Direction direction() const { return drive_.direction(); }
    bool has_target() const { return homed_ && armed(); }
    int32_t target_um() const { return target_um_; }
    int32_t height_um() const { return sensor_.height_um(); }
    uint16_t raw() const { return sensor_.raw(); }
    uint32_t now_ms() const { return now_ms_; }

private:
    enum class Homing : uint8_t { SEEK, BACK, LEAVE };

    PositionSensor sensor_;
    Contact lower_, upper_, stop_;
    Drive drive_;
    Mode mode_;
    Homing homing_ = Homing::SEEK;
    bool homed_ = false;
    uint16_t faults_;
    int32_t target_um_ = 0;
    int32_t back_um_ = 0;
    uint32_t now_ms_ = 0;
    uint32_t beat_ms_ = 0;
    uint32_t deadline_ms_ = 0;

    bool armed() const { return mode_ == Mode::HOLDING || mode_ == Mode::MOVING || mode_ == Mode::HOMING; }
    uint16_t causes() const;
    uint16_t contacts_wrong() const;
    uint16_t misplaced() const;
    uint16_t monitor();
    uint16_t limit_reached() const;
    void fail(uint16_t faults);
    void hold();
    void target_here();
    void step_move();
    bool arrived(int32_t distance_um) const;
    void step_homing();
    void step_seek();
    void step_back();
    void step_leave();
    void start(Mode mode, int32_t distance_um);
};
