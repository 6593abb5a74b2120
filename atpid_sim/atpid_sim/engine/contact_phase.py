# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A contact: beam and grain integrated together while a force acts between them.

A contact that begins at zero overlap is integrated in s with t = t_c + s^4: the contact laws' xi^(1/4) is then smooth
and the method keeps its order. From the deepest point on the variable is time, and where the grain stays in contact, so
that stability and no longer accuracy limits the explicit step, the implicit method takes over.
"""

import math

from atpid_sim.contact.dispatch import detachment_velocity, energy
from atpid_sim.contact.laws import HYSTERETIC
from atpid_sim.engine import columns as at
from atpid_sim.engine.arc import support_at
from atpid_sim.engine.detachment import EXPLICIT, FOURTH_ROOT, IMPLICIT, trial_step, vanishing
from atpid_sim.engine.dormand_prince import ContactModel, ContactState, Moment, rates_at, support_ahead
from atpid_sim.engine.error_control import DEPTH_FLOOR
from atpid_sim.engine.modal_step import end_of, enter_end, modal_rates
from atpid_sim.engine.modes import container_mass, mode_paces, resting_place
from atpid_sim.engine.rosenbrock import contact_pace
from atpid_sim.engine.sampling import contact_samples, next_sample, record_extreme, step_extreme
from atpid_sim.engine.state import steps_used
from atpid_sim.kernel import inlined, kernel

#: Steps times the contact's pace from which stability limits the explicit method.
_STIFF = 2.0
#: Share of the pace of the fastest of several modes that limits implicit steps: order and error control follow it.
_MODAL_STEP = 0.5
#: Steps of one uninterrupted contact before stiffness is checked: a short contact costs less with explicit steps.
_FIRST_CHECK = 100
#: Steps of one uninterrupted contact after which the vibration of a grain in static contact counts by displacement.
_LONG_CONTACT = 3000
#: Steps after which only the beam is still computed to the tolerance: elastic vibration without end is damped out.
_ENDLESS_CONTACT = 60_000


@kernel
def _model(n, system, law, memory):
    """Collect what is constant during a contact while its deepest overlap is `memory` [m]."""
    side = 1.0 if n[at.MODE] == at.ON_FLOOR else -1.0
    stiffness, damping, gravity = system.stiffness, system.damping, system.gravity
    inverse = 1.0 / container_mass(system.modes, system)
    both = inverse + 1.0 / system.grain_mass
    return ContactModel(law, HYSTERETIC[law], memory, side, stiffness, damping, gravity, inverse, both, system.modes)


@kernel
def _initial_motion(y, model, p, segment, diameter, moment):
    """Motion at the start of the contact, from the state."""
    x, v = y[at.BEAM], y[at.BEAM_VELOCITY]
    gap, velocity = y[at.GRAIN] - x, y[at.GRAIN_VELOCITY] - v
    if model.side > 0.0:
        overlap, velocity = -gap, -velocity
    else:
        overlap = gap - (segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * moment.tau - diameter)
        velocity = velocity - segment[at.CEILING_VELOCITY]
    overlap = max(0.0, overlap)
    u, w = support_ahead(segment, moment.tau, 0.0, moment.sine, moment.cosine)
    first = end_of(model.modes, y)
    return ContactState(x, v, overlap, velocity, _first_rates(first, model, p, u, w, x, v, overlap, velocity), first)


@kernel
def _first_rates(end, model, p, u, w, x, v, overlap, velocity):
    """`Rates` at the start of the contact."""
    if end is None:
        return rates_at(model, p, u, w, x, v, overlap, velocity)
    return modal_rates(model, p, u, w, end, overlap, velocity)


@kernel
def _to_state(y, model, segment, diameter, tau, motion):
    """Enter the motion at local time tau into the state."""
    y[at.BEAM], y[at.BEAM_VELOCITY] = motion.x, motion.v
    enter_end(model.modes, motion.end, y)
    if model.side > 0.0:
        y[at.GRAIN], y[at.GRAIN_VELOCITY] = motion.x - motion.overlap, motion.v - motion.velocity
    else:
        y[at.GRAIN] = motion.x + segment[at.HEIGHT] + segment[at.CEILING_VELOCITY] * tau - diameter + motion.overlap
        y[at.GRAIN_VELOCITY] = motion.v + motion.velocity + segment[at.CEILING_VELOCITY]


@inlined
def _moment(segment, tau, s):
    """Start of the next step."""
    angle = segment[at.OMEGA] * tau + segment[at.PHASE]
    return Moment(tau, s, math.sin(angle), math.cos(angle))


@inlined
def _fitted(method, h, tau, origin, s, until, longest):
    """Step in the method's own variable, its end in local time, and whether it reaches `until`."""
    if method == FOURTH_ROOT:
        end = origin + (s + h) ** 4
        if end - tau > longest:
            h = (tau - origin + longest) ** 0.25 - s
            end = origin + (s + h) ** 4
        if end >= until:
            return (until - origin) ** 0.25 - s, until, True
        return h, end, False
    h = min(h, longest)
    return (until - tau, until, True) if tau + h >= until else (h, tau + h, False)


@inlined
def _weighted_error(model, p, begin, end, errors, deepest, fastest, natural, rest, control, taken):
    """Error of a step over the one allowed; overlap and beam each relative to their own size."""
    size = abs(begin.x - rest) + abs(begin.v) / natural + control.displacement
    rtol = control.contact_rtol
    # errors as large as the overlap of static contact would cause spurious detachment
    shallow, slow = min(DEPTH_FLOOR * size, control.overlap / rtol), min(natural * size, control.velocity / rtol)
    depth = max(abs(end.overlap), begin.overlap, 0.1 * deepest, control.overlap, shallow)
    speed = max(abs(end.velocity), abs(begin.velocity), 0.1 * fastest, control.velocity, slow)
    if taken > _LONG_CONTACT:
        depth = math.inf if taken > _ENDLESS_CONTACT else depth
        speed = max(speed, contact_pace(model, p, begin.overlap, begin.velocity)[1] * depth)
    inner = (errors.overlap / depth) ** 2 + (errors.velocity / speed) ** 2
    outer = errors.x**2 + (errors.v / natural) ** 2
    return max(0.5 * math.sqrt(inner + outer / (size * size)) / rtol, 1e-6)


@kernel
def _after_rejection(method, h, error, missed):
    """Size with which a rejected step is repeated."""
    if missed:
        return 0.5 * h
    if math.isnan(error):
        return 0.1 * h
    return h * max(0.2, 0.9 * error ** (-0.25 if method == IMPLICIT else -0.2))


@inlined
def _after_acceptance(method, h, logarithm, previous):
    """Size of the step after one whose error had this logarithm, and the one before it that of `previous`."""
    if method == IMPLICIT:
        return h * min(6.0, max(0.2, 0.9 * math.exp(-0.25 * logarithm)))
    return h * min(5.0, max(0.2, 0.9 * math.exp(0.08 * previous - 0.14 * logarithm)))


@kernel
def _add_flows(y, model, p, moving, overlap, overlap1, flows):
    """Enter one step into the energy ledger; `moving`: velocity of the ceiling [m/s]."""
    lost = flows.contact
    if model.hysteretic:
        law, memory = model.law, model.memory
        lost += energy(law, overlap, memory, p) - energy(law, overlap1, max(overlap1, memory), p)
    y[at.CONTACT_LOSS] += max(0.0, lost)  # a law only dissipates; negative weights of the quadrature can break the sign
    y[at.INPUT] += flows.support
    y[at.BEAM_LOSS] += flows.damper
    y[at.CEILING_WORK] -= moving * flows.impulse


@kernel
def _observe(y, elapsed, begin, end):
    """Add one step to the observation window."""
    y[at.CONTACT_TIME] += elapsed
    record_extreme(y, end.x)
    if begin.v * end.v < 0.0:
        a0, a1 = begin.rates.beam_acceleration, end.rates.beam_acceleration
        step_extreme(y, elapsed, begin.x, begin.v, a0, end.x, end.v, a1)


@kernel
def _detach(y, n, model, p, motion, least):
    """End a contact whose force has vanished and set the mode; returns the motion with the remaining overlap."""
    law, memory, overlap, velocity = model.law, y[at.DEEPEST], motion.overlap, motion.velocity
    y[at.CONTACT_LOSS] += energy(law, max(overlap, 0.0), memory, p)  # still compressed, but no force is left
    undamped = not model.hysteretic and detachment_velocity(law, overlap, memory, p) == -math.inf
    if undamped or overlap < 1e-6 * max(least, memory):
        overlap = 0.0  # with no damping to speak of the force vanishes only where the surfaces part
        velocity = min(velocity, 0.0)  # rounding must not leave them closing: the same contact would begin again
    if overlap > 0.0:
        n[at.MODE] = at.OFF_FLOOR if model.side > 0.0 else at.OFF_CEILING
    else:
        n[at.MODE] = at.FREE
    return ContactState(motion.x, motion.v, overlap, velocity, motion.rates, motion.end)


@kernel
def contact(y, n, segment, tau, until, system, law, p, control, view, out):
    """Advance a contact inside one row from local time tau to at most `until`; returns the local time reached.

    Leaves y at that time and n[MODE] at what follows: still in contact, overlapped without force, or free.
    """
    model = _model(n, system, law, y[at.DEEPEST])
    diameter = 2.0 * system.radius
    moving = 0.0 if model.side > 0.0 else segment[at.CEILING_VELOCITY]
    natural = math.sqrt(system.stiffness / system.beam_mass)
    tone = segment[at.OMEGA] if segment[at.A0] != 0.0 or segment[at.A1] != 0.0 else 0.0
    own, rate = mode_paces(system.modes)
    pace, implicit_pace = max(tone, natural, rate), max(tone, natural, _MODAL_STEP * own)
    rest = resting_place(system.modes, system)
    motion = _initial_motion(y, model, p, segment, diameter, _moment(segment, tau, 0.0))
    method, origin, s, h = FOURTH_ROOT, tau, 0.0, min(y[at.FIRST_STEP], (until - tau) ** 0.25)
    if motion.overlap > 0.0:
        # a force near zero for long: the error of explicit steps would cause spurious detachment
        method = IMPLICIT if n[at.CONTACT_STEPS] > _ENDLESS_CONTACT else EXPLICIT
        origin, s, h = 0.0, tau, 1e-2 * y[at.FIRST_STEP] ** 4
    moment = _moment(segment, tau, s)
    start = support_at(segment, tau)[0]
    deepest, fastest = motion.overlap, abs(motion.velocity)
    previous = 0.0
    taken = 0
    due = next_sample(n, out, view)
    while tau < until and steps_used(n) < control.budget:
        longest = 0.3 / implicit_pace if method == IMPLICIT else 0.15 / pace
        h, end_time, finishing = _fitted(method, h, tau, origin, s, until, longest)
        end, errors, flows = trial_step(method, segment, model, p, moment, h, motion)
        error = _weighted_error(model, p, motion, end, errors, deepest, fastest, natural, rest, control, taken)
        detaching = end.rates.force <= 0.0
        # a whole contact inside the first step must be resolved, unless it is too weak to matter
        first = taken == 0 and method == FOURTH_ROOT
        missed = detaching and first and motion.velocity * (end_time - tau) > 1e-3 * control.overlap
        if missed or not error <= 1.0:
            n[at.REJECTED] += 1
            h = _after_rejection(method, h, error, missed)
            if h < 1e-25 and math.isnan(error):
                y[at.BEAM] = math.nan  # no step is short enough: the force itself is not a number
                return tau
            continue
        # the kink of a hysteretic law: below the deepest overlap the velocity may change its sign without one
        turning = model.hysteretic and motion.velocity > 0.0 and end.velocity < 0.0 and motion.overlap >= model.memory
        size = h
        if turning or detaching:
            size = vanishing(method, segment, model, p, moment, h, motion, end, turning)
        if size < h:
            end, errors, flows = trial_step(method, segment, model, p, moment, size, motion)
            end_time = origin + (s + size) ** 4 if method == FOURTH_ROOT else tau + size
            detaching = detaching and not turning
            finishing = False
            if turning:
                end = ContactState(end.x, end.v, end.overlap, 0.0, end.rates, end.end)
        n[at.CONTACT_STEPS] += 1
        elapsed = end_time - tau
        if first:
            y[at.FIRST_STEP] = h
        taken += 1
        _add_flows(y, model, p, moving, motion.overlap, end.overlap, flows)
        if view.observing:
            _observe(y, elapsed, motion, end)
        if due <= end_time:
            due = contact_samples(n, out, view, segment, model.side, diameter, tau, elapsed, motion, end)
        tau, motion = end_time, end
        s += size
        deepest = max(motion.overlap, 0.9 * deepest)
        fastest = max(abs(motion.velocity), 0.9 * fastest)
        if motion.overlap > y[at.DEEPEST]:
            y[at.DEEPEST] = motion.overlap
            if model.hysteretic:
                model = _model(n, system, law, motion.overlap)
        if detaching:
            motion = _detach(y, n, model, p, motion, control.overlap)
            break
        if motion.overlap > system.radius or finishing:
            break
        logarithm = math.log(error)
        h = _after_acceptance(method, h, logarithm, previous)
        previous = max(logarithm, -9.0)
        # change of method, written out here: as a function of its own it made a run 3 % slower
        if method == FOURTH_ROOT and (motion.velocity <= 0.0 or turning):
            # from the deepest point on in time: s^4 would only slow the step control down
            h = 4.0 * s * s * s * h
            method, origin = EXPLICIT, 0.0
        if method != IMPLICIT and taken > _FIRST_CHECK and taken % 8 == 0:
            stiff = elapsed * contact_pace(model, p, motion.overlap, motion.velocity)[0] > _STIFF
            if stiff or taken > _LONG_CONTACT:
                method, h = IMPLICIT, elapsed
        moment = _moment(segment, tau, s if method == FOURTH_ROOT else tau)
        s = moment.s
    if system.modes is None:
        y[at.INPUT] += 0.5 * system.stiffness * (support_at(segment, tau)[0] ** 2 - start**2)
    if view.observing and n[at.MODE] != at.ON_FLOOR:
        y[at.LONGEST] = max(y[at.LONGEST], view.origin + tau - y[at.BEGUN])
    _to_state(y, model, segment, diameter, tau, motion)
    return tau
