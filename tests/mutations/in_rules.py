# SPDX-License-Identifier: Apache-2.0
"""Mutations of the pure rules: frames, heights and travels, freshness, answers, limits, states."""

from mutation import Mutation

MOTOR = "atpid_driver/atpid_driver/motor/"
RULES = "atpid_control/atpid_control/supervision/"
TEST = "atpid_driver/test/"
SAFETY = TEST + "test_firmware_safety.py::test_"
PROTOCOL = TEST + "test_motor_protocol.py::test_"
SIMULATED = TEST + "test_motor_simulated.py::test_"
KNOWN = TEST + "test_known_motion.py::test_"
FRESH = TEST + "test_motor_freshness.py::test_"
SUPERVISION = "atpid_control/test/test_supervision.py::test_"
PERMITTED = SUPERVISION + "motion_is_permitted_only_while_every_needed_node_has_answered_within_the_answer_time"
STOPPED = SUPERVISION + "a_stop_holds_until_it_is_rearmed_and_never_permits_motion"
STATES = SUPERVISION + "each_state_follows_from_who_answers"
ENDED = SUPERVISION + "the_end_withdraws_the_permission_and_the_first_reason_of_a_stop_stays"
ABORTED = SUPERVISION + "an_abort_is_given_once_and_by_the_first_value_above_its_level"
REARMED = SUPERVISION + "an_aborted_quantity_is_rearmed_only_when_it_is_lower"
LEVELS = SUPERVISION + "levels_that_cannot_be_are_refused"
OTHERWISE = KNOWN + "what_moves_otherwise_is_named"
REFUSED = SIMULATED + "heights_outside_the_limits_are_refused_and_nothing_moves"
INACTIVE = SIMULATED + "does_not_move_before_it_is_activated_nor_after_it_is_deactivated"


def _in(name: str, file: str, old: str, new: str, why: str, *tests: str) -> Mutation:
    return Mutation(f"{file.rpartition('/')[2].removesuffix('.py')}: {name}", file, old, new, tests, why)


MUTATIONS = (
    # frames
    _in(
        "check sum not compared",
        MOTOR + "protocol.py",
        "if crc16(body) != given:",
        "if crc16(body) == -1:",
        "a garbled height is believed",
        PROTOCOL + "one_or_two_flipped_bits_are_always_refused",
    ),
    _in(
        "faults read as a decimal number",
        MOTOR + "protocol.py",
        "Fault(int(faults, 16))",
        "Fault(int(faults, 10))",
        "the fault that is reported is another",
        SAFETY + "outside_its_soft_limits_it_is_off_and_has_to_home_again",
    ),
    _in(
        "homed whatever the board answers",
        MOTOR + "protocol.py",
        "homed=bool(_whole(homed, 1)),",
        "homed=bool(_whole(homed, 1) + 1),",
        "heights are sent to a motor without a reference",
        SAFETY + "after_power_on_it_is_disarmed_and_identifies_itself",
    ),
    _in(
        "heights in millimetres",
        MOTOR + "protocol.py",
        "return round(height * 1e6)",
        "return round(height * 1e3)",
        "each height is refused or a thousandth",
        TEST + "test_motor_contract.py::test_it_travels_to_a_height_at_its_speed[serial]",
    ),
    _in(
        "any word is a reply",
        MOTOR + "protocol.py",
        'raise ProtocolError(f"reply {frame.word},',
        'return Refusal("OLD")\n        raise ProtocolError(f"reply {frame.word},',
        "an answer that is none passes for a refusal",
        PROTOCOL + "replies_that_are_none",
    ),
    # heights and travels
    _in(
        "no lowest height",
        MOTOR + "ceiling_actuator.py",
        "if not self.lowest <= height <= self.highest:",
        "if not height <= self.highest:",
        "the ceiling is driven on the grain",
        REFUSED,
    ),
    _in(
        "no highest height",
        MOTOR + "ceiling_actuator.py",
        "if not self.lowest <= height <= self.highest:",
        "if not self.lowest <= height:",
        "the ceiling is driven to its end",
        REFUSED,
    ),
    _in(
        "ready though not homed",
        MOTOR + "ceiling_actuator.py",
        "return self.homed and self.mode in",
        "return self.mode in",
        "the run begins while it homes",
        SIMULATED + "without_a_reference_no_height_can_be_commanded",
    ),
    _in(
        "limits not looked at",
        MOTOR + "simulated.py",
        "else self.limits.check(height)",
        "else height",
        "heights outside the limits are travelled to",
        REFUSED,
    ),
    _in(
        "moves while disarmed",
        MOTOR + "simulated.py",
        "if self._mode is not Mode.HOLDING:",
        "if self._mode is Mode.UNCONFIGURED:",
        "a motor that is off moves",
        INACTIVE,
    ),
    _in(
        "a hold goes on",
        MOTOR + "simulated.py",
        "goal = here if isnan(height)",
        "goal = self._travel.target if isnan(height)",
        "the operator's hold does nothing",
        SIMULATED + "nan_stops_and_stays",
    ),
    _in(
        "moves from an unknown place",
        MOTOR + "simulated.py",
        "if not self.placed:\n            raise",
        "if False:\n            raise",
        "it moves before it has homed",
        SIMULATED + "a_ceiling_that_is_not_placed_is_homing_and_moves_nowhere",
    ),
    _in(
        "a disarmed ceiling travels on",
        MOTOR + "ceiling_actuator.py",
        "self._halt(now, Mode.DISARMED)\n\n    def read",
        "self._mode = Mode.DISARMED\n\n    def read",
        "disarmed in motion it goes on to its target",
        INACTIVE,
    ),
    _in(
        "no heartbeat needed",
        MOTOR + "ceiling_actuator.py",
        "now - self._alive > HEARTBEAT_TIME:",
        "now - self._alive > 10**18:",
        "without its host the simulated motor goes on, unlike the real one",
        SIMULATED + "without_a_heartbeat_it_is_off_until_it_is_armed_again",
    ),
    _in(
        "a look is a heartbeat",
        MOTOR + "ceiling_actuator.py",
        "        if self._mode is Mode.HOLDING and now - self._alive",
        "        self._alive = now\n        if self._mode is Mode.HOLDING and now - self._alive",
        "a node that may not move it keeps it on",
        SIMULATED + "without_a_heartbeat_it_is_off_until_it_is_armed_again",
    ),
    _in(
        "armed without a connection",
        MOTOR + "ceiling_actuator.py",
        "if self._mode is Mode.UNCONFIGURED:\n            raise",
        "if False:\n            raise",
        "it is armed before it was identified",
        SIMULATED + "it_is_not_armed_before_it_is_connected",
    ),
    # known motion
    _in(
        "a motor that is off passes",
        MOTOR + "known_motion.py",
        "if not reading.ready:",
        "if False:",
        "a run begins with a motor that does not move",
        OTHERWISE,
    ),
    _in(
        "a wrong direction passes for longer",
        MOTOR + "known_motion.py",
        "if moved * wanted < 0.0 and",
        "if False and",
        "a run begins with swapped leads",
        KNOWN + "a_ceiling_that_moves_the_other_way_is_named_at_once",
    ),
    _in(
        "any speed passes",
        MOTOR + "known_motion.py",
        "if longest < usual / (1.0 + SPEED_TOLERANCE):",
        "if longest < 0.0:",
        "a sensor of another gain passes",
        KNOWN + "a_gain_that_is_wrong_shows_in_the_speed",
    ),
    _in(
        "a slow motor passes",
        MOTOR + "known_motion.py",
        "if shortest > usual / (1.0 - SPEED_TOLERANCE):",
        "if shortest > 1e9:",
        "a motor that slips passes",
        OTHERWISE,
    ),
    _in(
        "any distance",
        MOTOR + "known_motion.py",
        "if distance != 0.0 and not low <= distance <= high:",
        "if distance == -1.0:",
        "the motion that is to show that it is safe leaves the range",
        KNOWN + "a_distance_that_cannot_be_judged_or_may_not_fit_is_refused",
    ),
    _in(
        "interrupted, it goes on from there",
        MOTOR + "known_motion.py",
        "if isnan(self._origin) else self._origin",
        "",
        "each interruption takes the ceiling further",
        KNOWN + "an_interrupted_motion_begins_again_where_it_began_first",
    ),
    # freshness
    _in(
        "nothing is late",
        MOTOR + "freshness.py",
        "return (offset - self._least) * _NANO",
        "return 0.0",
        "heights from before an interruption move it",
        FRESH + "what_waited_is_old_and_what_comes_in_time_is_not",
    ),
    _in(
        "the least lateness is forgotten at once",
        MOTOR + "freshness.py",
        "_LEAK = 0.01",
        "_LEAK = 1.0",
        "the same, after a second",
        FRESH + "what_waited_is_old_and_what_comes_in_time_is_not",
    ),
    _in(
        "the least lateness is never forgotten",
        MOTOR + "freshness.py",
        "_LEAK = 0.01",
        "_LEAK = 0.0",
        "after hours every height is refused",
        FRESH + "a_clock_that_drifts_all_day_makes_no_command_old",
    ),
    _in(
        "a clock that goes back is not begun anew",
        MOTOR + "freshness.py",
        "or stamp < self._last[0]:",
        "or stamp < -1:",
        "after that nothing is late any more",
        FRESH + "a_source_that_begins_anew_is_not_judged_by_the_one_before",
    ),
    _in(
        "a new source is judged by the last",
        MOTOR + "freshness.py",
        "        self._last = None\n\n    def armed",
        "        pass\n\n    def armed",
        "the next run's heights are refused",
        FRESH + "a_source_that_begins_anew_is_not_judged_by_the_one_before",
    ),
    _in(
        "heights from before it was armed",
        MOTOR + "freshness.py",
        "return age * 1e9 > now - self._armed",
        "return False",
        "a person arms it and it goes where it was to go before",
        FRESH + "a_command_is_compared_with_the_time_the_motor_was_armed",
    ),
    # answers
    _in(
        "silence is seen late",
        RULES + "answers.py",
        "now - self._last[name] > self._answer_time or",
        "now - self._last[name] > 2.0 * self._answer_time or",
        "a hung node moves the ceiling for longer",
        PERMITTED,
    ),
    _in(
        "silent nodes are forgotten",
        RULES + "answers.py",
        "self._silent.add(name)",
        "self._silent.discard(name)",
        "a node that hangs stops nothing",
        PERMITTED,
    ),
    _in(
        "the supervisor's own halt is theirs",
        RULES + "answers.py",
        "min(self._last[name] + held_up, now)",
        "self._last[name]",
        "a busy machine stops the run",
        SUPERVISION + "time_in_which_the_supervisor_was_held_up_is_no_silence_of_others",
    ),
    _in(
        "every turn is the supervisor's own halt",
        RULES + "answers.py",
        "max(now - self._checked - self._turn, 0.0)",
        "now - self._checked",
        "no node is ever silent",
        PERMITTED,
    ),
    _in(
        "one that is silent is back at once",
        RULES + "answers.py",
        "if silence <= self._answer_time and name not in ended:",
        "if silence >= 0.0:",
        "a hung node permits motion again",
        PERMITTED,
    ),
    # limits
    _in(
        "half of the values pass",
        RULES + "limits.py",
        "self.levels.get(name, Levels()), abs(value)",
        "self.levels.get(name, Levels()), value",
        "a level is passed downwards unseen",
        ABORTED,
    ),
    _in(
        "an abort is a warning",
        RULES + "limits.py",
        "if magnitude > level.abort and",
        "if magnitude > 2.0 * level.abort and",
        "the motor goes on above the abort level",
        ABORTED,
    ),
    _in(
        "an abort is given once for ever",
        RULES + "limits.py",
        "self.aborted.clear()",
        "pass",
        "after a re-arm nothing stops it",
        REARMED,
    ),
    _in(
        "re-armed above its level",
        RULES + "limits.py",
        "> self.levels[name].abort)",
        "> math.inf)",
        "it is armed while the cause is there",
        REARMED,
    ),
    _in(
        "levels that are none",
        RULES + "limits.py",
        "if not level.warning > 0.0 or not level.abort > 0.0:",
        "if level.warning <= 0.0 or level.abort <= 0.0:",
        "a level that is no number limits nothing",
        LEVELS,
    ),
    # states
    _in(
        "no node is needed",
        RULES + "states.py",
        "if lost:",
        "if lost and False:",
        "without its controller the ceiling may move",
        PERMITTED,
    ),
    _in(
        "a fault permits",
        RULES + "states.py",
        "State.FAULT, permit=False",
        "State.FAULT, permit=True",
        "the same",
        PERMITTED,
    ),
    _in(
        "permitted before they have answered",
        RULES + "states.py",
        "permit = not any(name in self._needed for name in awaited)",
        "permit = True",
        "the motor is armed before the run is there",
        PERMITTED,
    ),
    _in(
        "a stop is not passed on",
        RULES + "states.py",
        "State.SAFE, permit=False, stop=True",
        "State.SAFE, permit=False, stop=False",
        "the motor is held, not switched off",
        STOPPED,
    ),
    _in(
        "a stop permits",
        RULES + "states.py",
        "State.SAFE, permit=False",
        "State.SAFE, permit=True",
        "stopped, it may be armed",
        STOPPED,
    ),
    _in(
        "re-armed without the nodes",
        RULES + "states.py",
        "if missing:",
        "if missing and False:",
        "a person arms a motor without a controller",
        STATES,
        STOPPED,
    ),
    _in(
        "the end permits",
        RULES + "states.py",
        "self._ended = True",
        "self._ended = False",
        "the motor moves on after the supervisor has ended",
        ENDED,
    ),
    _in(
        "the last reason of a stop",
        RULES + "states.py",
        "        if self._stopped:\n            return False\n",
        "",
        "the cause of a stop is lost",
        ENDED,
    ),
    _in(
        "given up late",
        RULES + "states.py",
        "> give_up > 0.0:",
        "> 2.0 * give_up > 0.0:",
        "a run without its controller goes on",
        STATES,
    ),
    # quantities
    _in(
        "a lone spike aborts",
        RULES + "quantities.py",
        "SUSTAINED = 3",
        "SUSTAINED = 1",
        "one wrong sample ends a run",
        SUPERVISION + "a_lone_spike_is_no_displacement_and_an_impact_is_an_acceleration",
    ),
    _in(
        "the motor's time never grows",
        RULES + "quantities.py",
        "return now - self._since",
        "return 0.0",
        "the motor overheats",
        SUPERVISION + "the_motor_is_timed_while_it_is_on_without_interruption",
    ),
    _in(
        "no contact is counted",
        RULES + "quantities.py",
        "if time - self._last_above > self._dead_time:",
        "if time - self._last_above > 1.0:",
        "the rate of impacts is not limited",
        SUPERVISION + "contacts_a_second_are_counted_over_blocks_of_any_size",
    ),
    # bags, by which a run is judged afterwards
    _in(
        "what the index leads to is not compared",
        "atpid_control/atpid_control/runs/verify.py",
        "if found != messages:",
        "if found > messages:",
        "a bag that other programs read in part is called whole",
        "atpid_control/test/test_recording_index.py::test_what_the_index_does_not_lead_to_is_no_whole_bag_and_recover_leads_to_it_again",
    ),
)
