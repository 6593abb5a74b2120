# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Mutations of what switches the exciter off: node, process of the output, watchdog, limits."""

from mutation import in_file as _in

NODE = "atpid_driver/atpid_driver/nodes/excitation_node.py"
SUPERVISED = "atpid_driver/atpid_driver/nodes/supervised_node.py"
ROOM = "atpid_driver/atpid_driver/excitation/"
TEST = "atpid_driver/test/test_excitation_"
OVER_DDS = TEST + "node.py::test_"
CONTRACT = TEST + "contract.py::test_"
SIGNALS = TEST + "signals.py::test_"
HOLD = TEST + "hold.py::test_"
PERMITTED = OVER_DDS + "it_runs_only_while_the_supervisor_permits"
HANGS = CONTRACT + "the_voltage_is_that_of_the_calibration_and_rests_after_silence_and_off"
LOST = CONTRACT + "where_its_process_is_killed_or_hangs_the_node_switches_off"
KILLED = CONTRACT + "where_all_processes_are_killed_the_devices_watchdog_acts"
REFUSED = CONTRACT + "it_follows_commands_within_its_limits_and_is_off_otherwise"

MUTATIONS = (
    _in(
        "an inactive node takes commands",
        SUPERVISED,
        'if not self._active:\n            raise NotReadyError(f"{what} refused',
        'if False:\n            raise NotReadyError(f"{what} refused',
        "a command that moves nothing is not refused",
        OVER_DDS + "it_is_off_in_every_state_but_active",
    ),
    _in(
        "commands without permission",
        SUPERVISED,
        'raise NotReadyError(f"{what} not taken up: {self._permit.reason}")',
        "pass",
        "a command that moves nothing is not refused",
        PERMITTED,
    ),
    _in(
        "a withdrawn permission ends nothing",
        NODE,
        "if self._active and not self._permit.granted and self._command is not OFF:",
        "if False:",
        "the shaker runs on although a node that it needs hangs",
        PERMITTED,
    ),
    _in(
        "never supervised",
        SUPERVISED,
        "supervised = settings.supervised and in_time",
        "supervised = False",
        "abort levels and the operator's stop leave the shaker on",
        PERMITTED,
    ),
    _in(
        "silence of commands ends nothing",
        SUPERVISED,
        "if self._supervision.stale.stale:\n            self._halt()",
        "pass",
        "without its commander the shaker runs on",
        OVER_DDS + "a_command_is_put_out_and_its_silence_ends_it",
    ),
    _in(
        "commands of several end nothing",
        SUPERVISED,
        "if self._gate.several_senders:\n            self._halt()",
        "pass",
        "two programs drive one shaker",
        OVER_DDS + "two_commanders_end_it",
    ),
    _in(
        "an inactive node leaves the output on",
        NODE,
        "        try:\n            self._drive.off()\n        except OutputLostError as error:\n"
        "            self._lost(error)\n        self._publish",
        "        self._publish",
        "the operator's stop leaves the shaker on",
        OVER_DDS + "it_is_off_in_every_state_but_active",
    ),
    _in(
        "an exciter activated beside another",
        SUPERVISED,
        "if self._duplicates.inhibits_motion:",
        "if False:",
        "two nodes drive one shaker",
        OVER_DDS + "beside_another_of_its_name_it_is_off_and_cannot_be_activated",
    ),
    _in(
        "activated without permission",
        SUPERVISED,
        'raise NotReadyError(f"no motion is permitted: {self._permit.reason}")',
        "pass",
        "it is armed although a node that it needs hangs",
        PERMITTED,
    ),
    _in(
        "commands of any age",
        SUPERVISED,
        "self._gate.check_fresh(info, self._now())",
        "pass",
        "a command from before an interruption shakes it",
        OVER_DDS + "a_command_that_waited_too_long_is_ignored",
    ),
    _in(
        "a silent process is waited for",
        ROOM + "guarded.py",
        "if self._asked is not None and time.monotonic() - self._asked > self._settings.stop_time + _CONFIRM:",
        "if False:",
        "a process that hangs holds the shaker on",
        LOST,
    ),
    _in(
        "nothing is switched off for a lost process",
        ROOM + "guarded.py",
        "            outlet.open()\n            outlet.close()",
        "            pass",
        "a killed process leaves the shaker on",
        LOST,
    ),
    _in(
        "off is not waited for",
        ROOM + "guarded.py",
        'self._wait("off", self._settings.stop_time + _CONFIRM)',
        "pass",
        "the operator is answered that a shaker is off that is on",
        CONTRACT + "the_voltage_is_that_of_the_calibration_and_rests_after_silence_and_off",
    ),
    _in(
        "off lasts until the next command",
        ROOM + "guarded.py",
        "        self._enabled = False\n        if self._partner is not None:",
        "        if self._partner is not None:",
        "a stop is ended by any command",
        CONTRACT + "it_follows_commands_within_its_limits_and_is_off_otherwise",
    ),
    _in(
        "a silent node ends nothing",
        ROOM + "outlet_process.py",
        "if now - self._received > SILENCE:",
        "if False:",
        "a node that hangs holds the shaker on",
        HANGS,
    ),
    _in(
        "a node that is gone ends nothing",
        ROOM + "outlet_process.py",
        "        except (EOFError, OSError):\n            self._ended = True\n            return",
        "        except (EOFError, OSError):\n            self._received = time.monotonic()\n            return",
        "a killed node leaves the shaker on",
        CONTRACT + "it_is_off_within_half_a_second_of_a_kill",
    ),
    _in(
        "Ctrl-C ends it first",
        ROOM + "outlet_process.py",
        "signal.signal(number, signal.SIG_IGN)",
        "pass",
        "the node loses its output while it stops, and reports a fault",
        CONTRACT + "the_voltage_is_that_of_the_calibration_and_rests_after_silence_and_off",
    ),
    _in(
        "no watchdog",
        ROOM + "outlets.py",
        "        self.rest()\n        self._set_watchdog()",
        "        self.rest()",
        "after a kill of both processes the shaker is on for good",
        KILLED,
    ),
    _in(
        "the watchdog leaves the output",
        ROOM + "outlets.py",
        'f"WATCHDOG_{terminal}_ENABLE_DEFAULT": 1.0,',
        'f"WATCHDOG_{terminal}_ENABLE_DEFAULT": 0.0,',
        "the same",
        KILLED,
    ),
    _in(
        "the watchdog leaves the stream",
        ROOM + "outlets.py",
        "_resets = True",
        "_resets = False",
        "a stream of the device writes on after the kill",
        KILLED,
    ),
    _in(
        "volts beyond the calibration",
        ROOM + "outlets.py",
        "np.clip(volts_of(self._calibration, values), *self._calibration.limits_volts)",
        "volts_of(self._calibration, values)",
        "the inverter goes faster than what it was calibrated for",
        CONTRACT + "no_voltage_leaves_the_range_of_the_calibration",
    ),
    _in(
        "any amplitude",
        ROOM + "signals.py",
        "if not 0.0 <= amplitude <= highest:",
        "if False:",
        "a command beyond the shaker's travel is put out",
        REFUSED,
    ),
    _in(
        "any frequency",
        ROOM + "signals.py",
        "if not low <= (value := getattr(command, name)) <= high:",
        "if not (value := getattr(command, name)):",
        "a command beyond the inverter's range is put out",
        REFUSED,
    ),
    _in(
        "a stop takes ten times as long",
        ROOM + "signals.py",
        "self._fall = self.amplitude / self.settings.stop_time",
        "self._fall = 0.1 * self.amplitude / self.settings.stop_time",
        "the shaker runs on for more than the stated time",
        CONTRACT + "it_follows_commands_within_its_limits_and_is_off_otherwise",
    ),
    _in(
        "a sweep that is not held goes on",
        ROOM + "signals.py",
        "if self._arrived and not self.waits:",
        "if self._arrived:",
        "the amplitude of a sweep is not what was commanded",
        SIGNALS + "a_sweep_goes_from_end_to_end_in_its_time_and_waits_where_told",
    ),
    _in(
        "any correction",
        ROOM + "hold.py",
        "self.value = max(-self.limit, min(self.limit, wanted))",
        "self.value = wanted",
        "a sensor that has come off drives the shaker to its end",
        HOLD + "what_cannot_be_reached_stays_within_the_correction_and_is_not_held",
    ),
)
