# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Mutations of the link to the board: what is written when, what confirms it, and what is then answered."""

from mutation import Mutation

MOTOR = "atpid_driver/atpid_driver/motor/"
TEST = "atpid_driver/test/"
DIALOGUE = TEST + "test_motor_dialogue.py::test_"
ANY_ORDER = TEST + "test_motor_dialogue.py::TestStops"
SESSION = TEST + "test_motor_session.py::test_"
SERIAL = TEST + "test_motor_serial.py::test_"
CONTRACT = TEST + "test_motor_contract.py::test_"
AT_ONCE = DIALOGUE + "however_late_the_answers_a_stop_is_written_at_once"
LOST_LINK = DIALOGUE + "a_stop_that_is_not_confirmed_is_reported_and_goes_on_over_a_lost_link"
AFTER_A_STOP = DIALOGUE + "a_height_after_a_stop_waits_until_that_is_confirmed"
NO_ANSWER = DIALOGUE + "a_board_that_does_not_answer_is_a_lost_link_which_stays_until_it_is_armed"
CALLER = DIALOGUE + "without_its_caller_the_heartbeat_ends"
WRONG_FIRMWARE = SESSION + "the_wrong_firmware"


def _in(name: str, file: str, old: str, new: str, why: str, *tests: str) -> Mutation:
    return Mutation(f"{file.removesuffix('.py')}: {name}", MOTOR + file, old, new, tests, why)


MUTATIONS = (
    # a stop
    _in(
        "a stop is never sent",
        "dialogue.py",
        "if self._stop is not None:\n            return self._due_stop",
        "if False:\n            return self._due_stop",
        "nothing but heartbeats reaches the board",
        AT_ONCE,
    ),
    _in(
        "a hold is none",
        "dialogue.py",
        'self._stop = Stop("STOP", sequence, now)',
        "pass",
        "the operator's hold does nothing",
        AT_ONCE + "[STOP-0.0]",
    ),
    _in(
        "a hold by the last answer only",
        "dialogue.py",
        "(self._moving is not None or self.reading.mode in _IN_MOTION)",
        "self.reading.mode in _IN_MOTION",
        "a hold right after a height is left out",
        DIALOGUE + "a_stop_right_after_a_move_whose_answer_has_not_come",
    ),
    _in(
        "a hold keeps the height",
        "dialogue.py",
        "self.goal = self._move = None\n        if self._stop is None and (",
        "if self._stop is None and (",
        "a height is sent after the hold",
        DIALOGUE + "a_stop_discards_a_height_that_was_not_written_yet",
    ),
    _in(
        "switched off, the height is kept",
        "dialogue.py",
        "self.heartbeat, self.goal, self._move = False, None, None",
        "self.heartbeat = False",
        "a height is sent after the stop",
        ANY_ORDER,
        DIALOGUE + "switched_off_a_height_that_waits_is_discarded",
    ),
    _in(
        "switched off, heartbeats go on",
        "dialogue.py",
        "self.heartbeat, self.goal, self._move = False, None, None",
        "self.goal, self._move = None, None",
        "the next height is taken up by a motor that is off",
        DIALOGUE + "switched_off_after_a_hold_that_is_not_confirmed_it_is_off_and_not_only_at_rest",
    ),
    _in(
        "a hold is enough to be switched off",
        "dialogue.py",
        'if self._stop is None or self._stop.word != "DISARM":',
        "if self._stop is None:",
        "the motor stays armed after a stop",
        DIALOGUE + "switched_off_after_a_hold_that_is_not_confirmed_it_is_off_and_not_only_at_rest",
    ),
    _in(
        "a stop leaves the arming",
        "dialogue.py",
        'self.end_arming(NotReadyError("a stop came before the board was armed"))',
        "",
        "it is armed after the stop",
        DIALOGUE + "a_stop_ends_arming",
    ),
    _in(
        "a height overtakes a stop",
        "dialogue.py",
        "if self._stop is not None:\n            return self._due_stop",
        "if self._stop is not None and self._move is None:\n            return self._due_stop",
        "the ceiling moves on after a stop",
        AFTER_A_STOP,
    ),
    _in(
        "arming overtakes a stop",
        "dialogue.py",
        "if self._stop is not None:\n            return self._due_stop",
        "if self._stop is not None and self._arming is None:\n            return self._due_stop",
        "a stop is forgotten by arming",
        ANY_ORDER,
    ),
    _in(
        "a stop is sent once",
        "dialogue.py",
        "stop.word, patience=STOP_REPEAT)",
        "stop.word, patience=1e9)",
        "a frame that is lost is a stop that is lost",
        LOST_LINK,
        ANY_ORDER,
    ),
    _in(
        "whatever is answered confirms a stop",
        "dialogue.py",
        "if not at_rest:",
        "if False:",
        "a stop is confirmed with the motor on",
        DIALOGUE + "an_answer_that_shows_the_motor_on_confirms_no_stop",
    ),
    _in(
        "any answer shows a ceiling at rest",
        "dialogue.py",
        "self._moving.not_after(answer.request) and ",
        "",
        "on a late line a hold is left out",
        DIALOGUE + "an_answer_to_an_earlier_request_does_not_show_a_ceiling_at_rest",
    ),
    _in(
        "what is not confirmed is not reported",
        "dialogue.py",
        "if not stop.reported and now - stop.since > CONFIRM_TIME:",
        "if False:",
        "the operator is not told to use the emergency stop",
        LOST_LINK,
    ),
    _in(
        "a lost link discards the stop",
        "dialogue.py",
        "self.identified = False\n        self._latched |=",
        "self.identified, self._stop = False, None\n        self._latched |=",
        "found again, the motor is not stopped",
        LOST_LINK,
    ),
    _in(
        "a height is sent for ever",
        "dialogue.py",
        "if waited > self._settings.command_timeout:",
        "if waited > 1e9:",
        "a height from long ago moves it when the line is back",
        DIALOGUE + "a_height_that_the_line_lost_is_sent_again_and_one_that_stays_unanswered_may_be_commanded_again",
    ),
    # heartbeat and link
    _in(
        "the heartbeat needs no caller",
        "dialogue.py",
        "alive = self.heartbeat and now - self._kept_alive < KEEP_ALIVE_TIME",
        "alive = self.heartbeat",
        "a hung node leaves the motor on",
        CALLER,
    ),
    _in(
        "the heartbeat outlasts its caller",
        "dialogue.py",
        "KEEP_ALIVE_TIME: Final = 0.25",
        "KEEP_ALIVE_TIME: Final = 2.5",
        "a hung node leaves the motor on for seconds",
        CALLER,
    ),
    _in(
        "every look is a heartbeat",
        "dialogue.py",
        '"BEAT" if alive else "STATE"',
        '"BEAT"',
        "a hung node leaves the motor on",
        CALLER,
    ),
    _in(
        "the link is never lost",
        "dialogue.py",
        "now - unanswered.asked > LINK_TIME:",
        "now - unanswered.asked > 1e9:",
        "the height shown is that of minutes ago",
        NO_ANSWER,
    ),
    _in(
        "a lost link is forgotten",
        "dialogue.py",
        "MotorFault.LINK_LOST if self.heartbeat else NO_FAULT",
        "NO_FAULT",
        "when the cable is back it goes on by itself",
        NO_ANSWER,
    ),
    _in(
        "a restart is forgotten",
        "dialogue.py",
        "self._latched |= MotorFault.RESTARTED",
        "pass",
        "a board that restarted in motion is not reported",
        SERIAL + "a_reset_in_motion_is_noticed_and_needs_a_person",
    ),
    _in(
        "a latched fault does not show",
        "dialogue.py",
        "mode=Mode.FAULT if self._latched else reply.mode,",
        "mode=reply.mode,",
        "heights are taken up without a person",
        DIALOGUE + "a_height_that_the_motor_cannot_have_reached_is_no_answer_of_the_board",
    ),
    _in(
        "any height is believed",
        "dialogue.py",
        "* elapsed + PLAY:",
        "* elapsed + 1e9:",
        "a garbled height is the ceiling's",
        DIALOGUE + "a_height_that_the_motor_cannot_have_reached_is_no_answer_of_the_board",
    ),
    _in(
        "a board that has forgotten the session is followed",
        "dialogue.py",
        'raise SessionLostError(f"the board no longer follows: {answer.reply}; it is identified again")\n        if self._move',
        "pass\n        if self._move",
        "heights go to a board that was restarted",
        DIALOGUE + "a_height_that_a_restarted_board_refuses_is_a_lost_session",
    ),
    # session
    _in(
        "an answer is taken twice",
        "session.py",
        "del self._waiting[earlier.sequence]  # the line",
        "pass  # the line",
        "an answer that the line repeats confirms a later request",
        SESSION + "an_answer_is_taken_once",
    ),
    _in(
        "any firmware",
        "session.py",
        "if reply.protocol != protocol.PROTOCOL or not reply.version.startswith(VERSION):",
        "if False:",
        "a board with another protocol is moved",
        WRONG_FIRMWARE,
    ),
    _in(
        "any board",
        "session.py",
        "if reply.name != protocol.NAME:",
        "if False:",
        "another device is sent heights",
        WRONG_FIRMWARE,
    ),
    _in(
        "limits wider than the firmware's",
        "session.py",
        "if limits.lowest < reply.lowest - 1e-9 or limits.highest > reply.highest + 1e-9:",
        "if False:",
        "heights are refused in the middle of a run",
        WRONG_FIRMWARE,
    ),
    _in(
        "a request is repeated as a new one",
        "session.py",
        "return self.request.frame\n\n    def answer",
        "return self.begin(now, self.request.word)\n\n    def answer",
        "a word that the line lost is carried out twice",
        SESSION + "a_repeated_request_has_the_same_bytes_and_gives_no_round_trip",
    ),
    # actuator, link
    _in(
        "limits not looked at",
        "serial_actuator.py",
        "goal = height if isnan(height) else self.limits.check(height)",
        "goal = height",
        "heights outside the parameters' limits are sent",
        CONTRACT + "heights_outside_the_limits_are_refused",
    ),
    _in(
        "a hold is sent as a height",
        "serial_actuator.py",
        "self._link.hold(sequence)",
        "pass",
        "the operator's hold does nothing",
        CONTRACT + "nan_stops_it_where_it_is[serial]",
    ),
    _in(
        "deactivated it stays on",
        "serial_actuator.py",
        'confirm it."""\n        self._link.disarm()',
        'confirm it."""',
        "a stop does nothing",
        CONTRACT + "deactivated_on_the_way_it_stops_at_once[serial]",
    ),
    _in(
        "a motor that is not ready takes heights",
        "serial_actuator.py",
        "if not (reading.ready and self._link.heartbeat):",
        "if False:",
        "heights are promised that nothing carries out",
        CONTRACT + "connected_it_is_disarmed_and_does_not_move[serial]",
    ),
    _in(
        "a look is a heartbeat",
        "serial_actuator.py",
        'unless `read` is called as well."""\n        return',
        'unless `read` is called as well."""\n        self._link.keep_alive()\n        return',
        "a node that may not move it keeps it on",
        SERIAL + "looking_at_it_does_not_keep_it_on",
    ),
    _in(
        "closed it stays on",
        "link.py",
        "self._dialogue.disarm(time.monotonic())\n                self._closing.set()",
        "self._closing.set()",
        "the motor runs on for half a second after Ctrl-C",
        SERIAL + "closing_disarms",
    ),
    _in(
        "a stop that is not confirmed is answered as done",
        "link.py",
        "confirmed.result(timeout=CONFIRM_TIME)",
        "return",
        "the operator is answered that a motor is off that is on",
        SERIAL + "a_stop_without_a_line_is_not_answered_as_done",
    ),
)
