# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names of the places in the engine's arrays. Kernels (`y[at.BEAM]`) and callers never index by a bare number.

They are plain integers, which numba compiles to constants: access costs the same as a bare index
(docs/decisions/0007-integration.md).
"""

# Drive table, float64 (rows, DRIVE_COLUMNS); local time tau is measured from START.
(
    START,  # of the row [s]
    END,  # of the row [s]
    A0,  # amplitude of the tone at START [m]
    A1,  # its slope [m/s]
    OMEGA,  # angular frequency of the tone [rad/s]
    PHASE,  # of the tone at START [rad]
    C0,  # cubic: C0 + C1 tau + C2 tau^2 + C3 tau^3 [m]
    C1,  # [m/s]
    C2,  # [m/s^2]
    C3,  # [m/s^3]
    HEIGHT,  # of the ceiling above the floor at START [m]
    CEILING_VELOCITY,  # relative to the floor [m/s]
    DRIVE_COLUMNS,
) = range(13)

# State, float64 (STATE_SIZE,).
(
    TIME,  # [s]
    BEAM,  # displacement of beam and container floor [m]
    BEAM_VELOCITY,  # [m/s]
    GRAIN,  # displacement of the grain; equal to BEAM where it just touches the floor [m]
    GRAIN_VELOCITY,  # [m/s]
    DEEPEST,  # deepest overlap of the present contact [m]; negative: a contact has just begun
    INPUT,  # work done by the support [J]; not a number: no ledger is kept
    BEAM_LOSS,  # dissipated by the beam's damping [J]
    CONTACT_LOSS,  # absorbed by the contacts [J]
    CEILING_WORK,  # work done by the ceiling's drive [J]
    LOWEST,  # beam in the observation window [m]
    HIGHEST,  # [m]
    CONTACT_TIME,  # in contact inside the window [s]
    FIRST_STEP,  # first step of the last contact, in its own variable
    LONGEST,  # longest single contact inside the window [s]
    BEGUN,  # when the present contact began [s]
    STATE_SIZE,
) = range(17)

# Counters, int64 (COUNTERS,).
(
    MODE,  # one of the modes below
    FLOOR_HITS,
    CEILING_HITS,
    WINDOW_FLOOR,  # impacts inside the observation window
    WINDOW_CEILING,
    CONTACT_STEPS,
    FLIGHT_STEPS,
    REJECTED,  # steps that were repeated
    SAMPLE,  # samples written
    IMPACTS,  # rows of the impact log written
    LOW_HOPS,  # flights too low to matter, see `micro_bounce`
    COUNTERS,
) = range(12)

# Modes. OFF_: overlapped, but without force.
FREE, ON_FLOOR, ON_CEILING, OFF_FLOOR, OFF_CEILING = range(5)

# Sample series, float64 (SAMPLE_ROWS, n).
(
    S_SUPPORT,  # displacement [m]
    S_BEAM,  # displacement [m]
    S_VELOCITY,  # of the beam [m/s]
    S_ACCELERATION,  # of the beam [m/s^2]
    S_GRAIN,  # displacement [m]
    S_CEILING,  # height above the floor [m]
    SAMPLE_ROWS,
) = range(7)

# Impact log, float64 (capacity, IMPACT_COLUMNS).
(
    E_TIME,  # [s]
    E_WALL,  # +1 floor, -1 ceiling
    E_SPEED,  # closing speed [m/s]
    IMPACT_COLUMNS,
) = range(4)

# Uncoupled modes, float64 (SET_ROWS, modes): the structure in flight, below it with the grain held, then the matrices
# (modes, modes) that lead from the coordinates of the one to those of the other and back.
(
    MASS,  # that an impulse at the container meets [kg]
    STIFFNESS,  # [N/m]
    DAMPING,  # [N s/m]
    DIRECT,  # force for a unit of the drive's signal
    RATE,  # and of its rate of change
    WEIGHT,  # acceleration by the weight [m/s^2]
    SET_ROWS,
) = range(7)

# Behind the state where the structure has several modes, float64 (modes, MODE_COLUMNS).
(
    Q,  # part of the beam's displacement [m]
    Q_RATE,  # [m/s]
    Q_INPUT,  # work of the force that drives the mode [J]
    Q_LOSS,  # dissipated by its damping [J]
    Q_CONTACT,  # work of contacts on it [J]
    MODE_COLUMNS,
) = range(6)
