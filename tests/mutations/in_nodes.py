# SPDX-License-Identifier: Apache-2.0
"""Mutations of what stands between the graph and the motor: permit, commander, duplicates, supervisor."""

from mutation import Mutation

NODES = "atpid_driver/atpid_driver/nodes/"
SUPERVISOR = "atpid_control/atpid_control/nodes/"
TEST = "atpid_driver/test/"
PERMIT = TEST + "test_motion_permit.py::test_"
COMMANDER = TEST + "test_motor_commander.py::test_"
NODE = TEST + "test_motor_node.py::test_"
DUPLICATES = TEST + "test_duplicate_nodes.py::test_while_another_is_there_that_was_there_before_nothing_arms_it"
SUPERVISES = "tests/test_supervisor_node.py::test_"
WITHDRAWN = PERMIT + "a_permission_that_is_withdrawn_holds_it_without_heartbeats"
SILENT = PERMIT + "a_supervisor_that_falls_silent_withdraws_its_permission"
UNARMED = PERMIT + "without_a_supervisor_it_is_not_armed"
BESIDE = COMMANDER + "beside_an_unauthorised_publisher_nothing_moves_until_it_is_gone"
COUNT = COMMANDER + "a_count_that_goes_back_or_leaps_is_another_publishers_until_the_first_has_left"
NO_ANSWER = SUPERVISES + "a_node_that_does_not_answer_withdraws_the_permission_until_it_does"
LEVEL = SUPERVISES + "a_level_that_is_passed_stops_and_is_armed_again_only_below_it"


def _in(name: str, file: str, old: str, new: str, why: str, *tests: str) -> Mutation:
    return Mutation(f"{file.rpartition('/')[2].removesuffix('.py')}: {name}", file, old, new, tests, why)


MUTATIONS = (
    _in(
        "always granted",
        NODES + "authority.py",
        "or (self._permitted and not self._silent)",
        "or True",
        "the supervisor stops nothing",
        UNARMED,
    ),
    _in(
        "silence does not end it",
        NODES + "authority.py",
        "(self._permitted and not self._silent)",
        "self._permitted",
        "without its supervisor the motor moves on",
        SILENT,
    ),
    _in(
        "any message permits",
        NODES + "authority.py",
        "(self._permitted and not self._silent)",
        "not self._silent",
        "a supervisor that refuses permits",
        WITHDRAWN,
    ),
    _in(
        "a permission is for ever",
        NODES + "authority.py",
        "self._permitted, self._reason = bool(state.permit), ",
        "self._permitted, self._reason = self._permitted or bool(state.permit), ",
        "the same, once it has permitted",
        WITHDRAWN,
    ),
    _in(
        "silence counts late",
        NODES + "authority.py",
        "> self._timeout",
        "> 1000.0 * self._timeout",
        "without its supervisor the motor moves on for minutes",
        SILENT,
    ),
    _in(
        "a stop is only a hold",
        NODES + "authority.py",
        "if state.stop:",
        "if False:",
        "a stop leaves the motor armed",
        PERMIT + "a_stop_switches_the_motor_off_until_it_is_activated_again",
    ),
    _in(
        "two publishers are one",
        NODES + "authority.py",
        "if len(names) > 1:",
        "if len(names) > 2:",
        "whoever publishes last moves the ceiling",
        BESIDE,
    ),
    _in(
        "a second publisher is not looked for",
        NODES + "authority.py",
        "count_publishers(self._resolved) < 2",
        "count_publishers(self._resolved) < 3",
        "the same",
        BESIDE,
    ),
    _in(
        "any node may command",
        NODES + "authority.py",
        "if self._name and names and names[0] != wanted:",
        "if False:",
        "another node moves the stand",
        COMMANDER + "the_stands_motor_follows_the_node_named_only",
    ),
    _in(
        "two of one name are one",
        NODES + "authority.py",
        "if number and not in_turn and",
        "if False and",
        "two controllers move the ceiling in turn",
        COMMANDER + "of_two_of_one_name_that_both_send_the_first_is_followed",
        COUNT,
    ),
    _in(
        "any leap of the count",
        NODES + "authority.py",
        "self._number < number <= self._number + MOST_LOST",
        "self._number < number",
        "a second controller whose count is higher takes over",
        COUNT,
    ),
    _in(
        "the first is waited for",
        NODES + "authority.py",
        "<= self._silence:",
        "<= 1e9:",
        "after a restart of the controller the ceiling stays for good",
        COMMANDER + "one_that_was_started_again_is_followed",
        COUNT,
    ),
    _in(
        "a ceiling on its way goes on",
        NODES + "authority.py",
        "self.several = bool(problem)",
        "self.several = False",
        "it goes on to a height that nobody stands for",
        COMMANDER + "it_stops_a_ceiling_on_its_way",
    ),
    _in(
        "a second motor node is never inhibited",
        NODES + "authority.py",
        "self._present and (starting or self.inhibits_motion)",
        "False",
        "two nodes move one ceiling",
        DUPLICATES,
    ),
    _in(
        "a second motor node is inhibited for three seconds",
        NODES + "authority.py",
        "(starting or self.inhibits_motion)",
        "starting",
        "two nodes move one ceiling",
        DUPLICATES,
    ),
    _in(
        "a second motor node stays on",
        NODES + "authority.py",
        "return Event.ALARM,",
        "return Event.WARNING,",
        "one that was armed before it saw the other stays so",
        DUPLICATES,
    ),
    _in(
        "two of one name are one",
        "atpid_interfaces/atpid_common/atpid_common/nodes/single_instance.py",
        "node.get_namespace())) <= 1",
        "node.get_namespace())) <= 2",
        "two nodes move one ceiling",
        DUPLICATES,
    ),
    _in(
        "silence of commands stops nothing",
        NODES + "motor_node.py",
        "        if self._supervision.stale.stale:\n            self._stop_moving()",
        "        pass",
        "without its controller the ceiling goes on to a height that may be out of date",
        NODE + "commands_that_stay_away_stop_the_ceiling_where_it_is",
    ),
    _in(
        "commands of any age",
        NODES + "motor_commands.py",
        "if waited > self._settings.command_timeout:",
        "if waited > 1e9:",
        "a height from before an interruption moves it",
        NODE + "a_command_that_waited_too_long_is_ignored",
    ),
    _in(
        "commands from before it was armed",
        NODES + "motor_commands.py",
        "if self._freshness.before_armed(waited, now):",
        "if False:",
        "a person arms it and it goes where it was to go before",
        TEST + "test_motor_freshness.py::test_what_was_commanded_before_it_was_armed_does_not_move_it",
    ),
    _in(
        "a withdrawn permission holds nothing",
        NODES + "motor_node.py",
        "            self._stop_moving()\n            if self._actuator.observe",
        "            if self._actuator.observe",
        "the ceiling travels on until its heartbeat is missed",
        WITHDRAWN,
    ),
    _in(
        "heartbeats without permission",
        NODES + "motor_node.py",
        "return actuator.read(self._now()) if self._permit.granted else actuator.observe(self._now())",
        "return actuator.read(self._now())",
        "the motor stays armed without its supervisor",
        WITHDRAWN,
    ),
    _in(
        "activated without permission",
        NODES + "motor_node.py",
        '        if not self._permit.granted:\n            raise NotReadyError(f"no motion is permitted: {self._permit.reason}")\n        self._arm()',
        "        self._arm()",
        "it homes before its supervisor is there",
        UNARMED,
    ),
    _in(
        "armed again without permission",
        NODES + "motor_node.py",
        '            if not self._permit.granted:\n                raise NotReadyError(f"no motion is permitted',
        '            if False:\n                raise NotReadyError(f"no motion is permitted',
        "it is armed although a node that it needs hangs",
        WITHDRAWN,
    ),
    _in(
        "heights without permission",
        NODES + "motor_node.py",
        '            if not self._permit.granted:\n                raise NotReadyError(f"ceiling height',
        '            if False:\n                raise NotReadyError(f"ceiling height',
        "it moves although a node that it needs hangs",
        WITHDRAWN,
    ),
    _in(
        "activated beside another",
        NODES + "motor_node.py",
        "        if self._duplicates.inhibits_motion:\n            raise",
        "        if False:\n            raise",
        "two nodes move one ceiling",
        DUPLICATES,
    ),
    _in(
        "commands of several are left",
        NODES + "motor_node.py",
        "if self._gate.several_senders:",
        "if False:",
        "it goes on to a height that nobody stands for",
        COMMANDER + "it_stops_a_ceiling_on_its_way",
    ),
    _in(
        "an unconfirmed stop is answered as done",
        NODES + "motor_node.py",
        "response.success, response.message = False, str(error)\n        else:\n            again",
        "response.success, response.message = True, str(error)\n        else:\n            again",
        "the operator is answered that a motor is off that is on",
        TEST + "test_motor_node_serial.py::test_a_stop_is_answered_with_the_boards_own_state",
    ),
    _in(
        "permits whatever the rules find",
        SUPERVISOR + "supervisor_node.py",
        "permit=situation.permit, stop=",
        "permit=True, stop=",
        "a node that hangs stops nothing",
        NO_ANSWER,
    ),
    _in(
        "asks nobody",
        SUPERVISOR + "supervisor_node.py",
        "self._questions.ask(now)",
        "pass",
        "the run does not begin",
        NO_ANSWER,
    ),
    _in(
        "answers are not judged",
        SUPERVISOR + "supervisor_node.py",
        'for change in self._answers.check(now, self._questions.ended().intersection(self._values["needed"])):',
        "for change in ():",
        "a node that hangs stops nothing",
        NO_ANSWER,
    ),
    _in(
        "an abort is an event only",
        SUPERVISOR + "supervisor_node.py",
        "self._stop(str(passed))",
        "pass",
        "above the abort level the motor goes on",
        LEVEL,
    ),
    _in(
        "blocks are not judged",
        SUPERVISOR + "supervisor_node.py",
        "self._quantities.on_block(block, time.monotonic())",
        "pass",
        "above the abort level the motor goes on",
        LEVEL,
    ),
    _in(
        "the motor is not timed",
        SUPERVISOR + "supervisor_node.py",
        "state.mode in (CeilingState.HOMING, CeilingState.MOVING)",
        "state.mode == CeilingState.HOMING",
        "the motor overheats",
        SUPERVISES + "a_motor_that_is_on_for_too_long_is_stopped",
    ),
    _in(
        "the operator's stop is not latched",
        SUPERVISOR + "supervisor_node.py",
        'self._stop("stopped by the operator")',
        "pass",
        "the operator's stop does nothing",
        SUPERVISES + "the_operators_stop_is_latched_until_a_rearm",
    ),
    _in(
        "its end permits",
        SUPERVISOR + "supervisor_node.py",
        "self._supervision.end()",
        "pass",
        "its last message permits motion",
        SUPERVISES + "its_end_withdraws_the_permission",
    ),
    _in(
        "a failed loop check ends nothing",
        SUPERVISOR + "supervisor_node.py",
        "self._stop(f\"loop check: {'; '.join(found)}\")",
        "pass",
        "a run with a dead sensor keeps its motor armed",
        SUPERVISES + "a_loop_that_fails_its_check_is_stopped_and_ends",
    ),
    _in(
        "a needed node may stay away",
        SUPERVISOR + "supervisor_node.py",
        "        if lost:\n            silence",
        "        if False:\n            silence",
        "a run without its controller goes on for hours",
        SUPERVISES + "one_that_ends_the_run_is_named",
    ),
)
