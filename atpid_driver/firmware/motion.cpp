// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
#include "motion.h"

#include "faults.h"

namespace {
int32_t magnitude(int32_t value) { return value < 0 ? -value : value; }
}  // namespace

Motion::Motion(uint16_t faults_at_boot)
    : mode_(faults_at_boot ? Mode::FAULT : Mode::DISARMED), faults_(faults_at_boot) {}

void Motion::step(const Inputs &inputs) {
    now_ms_ = inputs.now_ms;
    lower_.update(inputs.lower_open);
    upper_.update(inputs.upper_open);
    stop_.update(inputs.stop_open);
    uint16_t seen = sensor_.update(inputs.raw, inputs.count, now_ms_);
    seen |= contacts_wrong();
    if (!(seen & fault::SENSOR)) seen |= misplaced() | monitor();  // without a position the rest would only guess
    if (seen) fail(seen);
    if (mode_ == Mode::HOMING) step_homing();
    if (mode_ == Mode::MOVING) step_move();
    if (!armed()) drive_.off(now_ms_);  // takes precedence over all of the above
}

// Faults whose cause is there now and keeps the motor from being armed.
uint16_t Motion::causes() const { return sensor_.causes() | contacts_wrong() | misplaced(); }

uint16_t Motion::contacts_wrong() const {
    const uint16_t stop = stop_.open() ? fault::EMERGENCY_STOP : 0;
    return lower_.open() && upper_.open() ? stop | fault::BOTH_LIMITS : stop;
}

// A limit switch that is open where the ceiling cannot touch it is stuck or its wire is broken.
uint16_t Motion::misplaced() const {
    uint16_t found = 0;
    if (lower_.open() && height_um() > LOWEST_UM + SWITCH_MARGIN_UM) found |= fault::LOWER_LIMIT;
    if (upper_.open() && height_um() < HIGHEST_UM - SWITCH_MARGIN_UM) found |= fault::UPPER_LIMIT;
    return found;
}

// Faults of the motion itself and of the link.
uint16_t Motion::monitor() {
    if (mode_ == Mode::DISARMED) return 0;
    uint16_t found = drive_.check(height_um(), now_ms_);
    if (!armed()) return found;
    found |= limit_reached();
    if (now_ms_ - beat_ms_ > HEARTBEAT_MS) found |= fault::HEARTBEAT;
    if (drive_.on() && static_cast<int32_t>(now_ms_ - deadline_ms_) > 0) found |= fault::OVERTIME;
    const bool outside = height_um() < LOWEST_UM - SOFT_MARGIN_UM || height_um() > HIGHEST_UM + SOFT_MARGIN_UM;
    return homed_ && outside ? found | fault::SOFT_LIMIT : found;
}

uint16_t Motion::limit_reached() const {
    if (drive_.direction() == Direction::DOWN && lower_.open()) return fault::LOWER_LIMIT;
    if (drive_.direction() == Direction::UP && upper_.open() && mode_ != Mode::HOMING) return fault::UPPER_LIMIT;
    return 0;
}

void Motion::fail(uint16_t faults) {
    drive_.off(now_ms_);
    faults_ |= faults;
    if (faults & fault::DISTRUST) homed_ = false;
    mode_ = Mode::FAULT;
}

void Motion::hold() {
    drive_.off(now_ms_);
    mode_ = Mode::HOLDING;
}

// The target of a ceiling at rest is where it stands, inside the soft limits: coasting and noise may show it just outside.
void Motion::target_here() {
    const int32_t height_um = sensor_.height_um();
    target_um_ = height_um < LOWEST_UM ? LOWEST_UM : height_um > HIGHEST_UM ? HIGHEST_UM : height_um;
}

void Motion::start(Mode mode, int32_t distance_um) {
    const uint32_t nominal_ms = static_cast<uint32_t>(distance_um / (SPEED_UM_PER_S / 1000));
    deadline_ms_ = now_ms_ + 2 * nominal_ms + OVERTIME_MS;
    mode_ = mode;
}

Answer Motion::arm() {
    if (armed()) return Answer::OK;
    const uint16_t left = causes();
    if (left) {
        fail(left);
        return Answer::FAULT;
    }
    faults_ = 0;
    target_here();
    beat();
    drive_.settle(now_ms_);
    hold();
    return Answer::OK;
}

Answer Motion::home() {
    if (mode_ == Mode::FAULT) return Answer::FAULT;
    if (!armed()) return Answer::DISARMED;
    if (mode_ == Mode::HOMING) return Answer::BUSY;
    homed_ = false;
    sensor_.reset_reference();
    homing_ = Homing::SEEK;
    start(Mode::HOMING, HOME_UM);
    return Answer::OK;
}

Answer Motion::move(int32_t target_um) {
    if (mode_ == Mode::FAULT) return Answer::FAULT;
    if (!armed()) return Answer::DISARMED;
    if (mode_ == Mode::HOMING) return Answer::BUSY;
    if (!homed_) return Answer::UNHOMED;
    if (target_um < LOWEST_UM || target_um > HIGHEST_UM) return Answer::RANGE;
    if (mode_ == Mode::MOVING && target_um == target_um_) return Answer::OK;
    target_um_ = target_um;
    start(Mode::MOVING, magnitude(target_um - height_um()));
    if (magnitude(target_um - height_um()) <= DEAD_BAND_UM) hold();
    return Answer::OK;
}

Answer Motion::stop() {
    if (mode_ == Mode::FAULT) return Answer::FAULT;
    if (!armed()) return Answer::DISARMED;
    target_here();
    hold();
    return Answer::OK;
}

void Motion::disarm() {
    drive_.off(now_ms_);
    if (armed()) mode_ = Mode::DISARMED;
}

void Motion::step_move() {
    const int32_t distance = target_um_ - height_um();
    if (drive_.on() ? arrived(distance) : magnitude(distance) <= DEAD_BAND_UM) return hold();
    drive_.go(distance > 0 ? Direction::UP : Direction::DOWN, now_ms_);
}

// Far behind a running motor the target is not reached: it was commanded while the ceiling moved away, which must turn.
bool Motion::arrived(int32_t distance) const {
    const int32_t ahead = distance * static_cast<int8_t>(drive_.direction());
    return ahead <= STOP_LEAD_UM && ahead >= -DEAD_BAND_UM;
}

void Motion::step_homing() {
    switch (homing_) {
        case Homing::SEEK: return step_seek();
        case Homing::BACK: return step_back();
        case Homing::LEAVE: return step_leave();
    }
}

// Up until the upper switch opens: away from the grain, so that homing can crush nothing.
void Motion::step_seek() {
    if (sensor_.beyond_home()) return fail(fault::HOMING);
    if (!upper_.open()) return drive_.go(Direction::UP, now_ms_);
    drive_.off(now_ms_);
    back_um_ = height_um();
    homing_ = Homing::BACK;
}

// Down until it closes again: that edge is the reference.
void Motion::step_back() {
    if (back_um_ - height_um() > BACK_OFF_UM) return fail(fault::UPPER_LIMIT);
    drive_.go(Direction::DOWN, now_ms_);
    if (upper_.open()) return;
    if (!sensor_.plausible_home()) return fail(fault::HOMING);
    sensor_.reference();
    drive_.settle(now_ms_);  // the height has leapt by what the potentiometer had slipped: that is no motion
    homing_ = Homing::LEAVE;
}

// Down into the soft limits; only there is the ceiling homed.
void Motion::step_leave() {
    drive_.go(Direction::DOWN, now_ms_);
    if (height_um() > HIGHEST_UM + STOP_LEAD_UM) return;
    homed_ = true;
    target_here();
    hold();
}
