# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The documentation is true: its commands run, its links lead somewhere, and what it names exists."""

import contextlib
import fnmatch
import functools
import io
import re
from pathlib import Path

import pytest
from documented import PAGES, ROOT, Piece, anchors, commands, exists, files, links, pieces

from atpid_control.cli import COMMANDS as ATPID
from atpid_control.cli import main as atpid
from studies.cli import COMMANDS as STUDIES
from studies.cli import main as studies

#: The tests that run a documented command, or a shorter one like it: file, pattern for the command's beginning, test.
RUN = {
    "tests/test_bootstrap.py": {
        r"\. ros2_ws/activate$": "test_an_activated_shell_finds_what_a_fresh_one_does",
        r"make setup$": "test_a_second_run_does_nothing",
        r"make test-packages$": "test_what_is_asked_for_beside_is_installed_once_for_each_environment",
    },
    "tests/test_docs.py": {r"atpid bag report ": "test_the_report_of_the_recorded_bag"},
    "atpid_control/test/test_traces.py": {
        r"atpid bag traces ": "test_a_slower_rate_takes_every_nth_sample",
    },
    "tests/test_parameters_page.py": {
        r"python -m studies parameters": "test_a_table_or_file_that_is_out_of_date_is_made_anew",
    },
    "tests/test_foxglove.py": {
        r"python -m atpid_control\.nodes\.foxglove_node": "test_a_viewer_receives_messages_and_traces",
        r"ros2 run atpid_control foxglove_node": "test_a_viewer_receives_messages_and_traces",
    },
    "tests/test_docs_tutorial.py": {r"atpid --help$": "test_each_command_does_its_step"},
    "tests/test_faults.py": {
        r"python -m studies faults .*--sequences": "test_a_random_sequence_ends_in_documented_states",
        r"python -m studies faults ": "test_the_command_runs_a_part_of_the_matrix",
    },
    "tests/test_figures.py": {
        r"make (bench|figures)$": "test_a_picture_shows_what_is_computed_now",
        r"atpid bench (?!.*--real-time)": "test_a_picture_shows_what_is_computed_now",
        r"python -m studies figures stand": "test_the_drawings_and_the_table_of_the_stand_are_what_is_computed_now",
        r"python -m studies figures mechanism": "test_the_mechanism_moves_as_it_is_simulated_now",
        r"python -m studies figures (contact|free_decay)": "test_a_picture_shows_what_is_computed_now",
    },
    "atpid_control/test/test_doctor.py": {r"atpid doctor": "test_the_worst_finding_is_the_status"},
    "atpid_control/test/test_first_run.py": {r"atpid first-run": "test_the_emulated_stand_unattended"},
    "atpid_control/test/test_validation.py": {
        r"atpid bag validate ": "test_the_bag_that_comes_along_is_its_own_simulation"
    },
    "tests/test_howto_selector.py": {r"python -m pytest test_proportional": "test_the_steps_of_the_page_run"},
    "tests/test_wheel.py": {r"python -m atpid_sim$": "test_in_an_empty_environment"},
    "tests/test_benchmark.py": {r"make benchmark$": "test_each_part_has_a_ratio"},
    "tests/test_fresh.py": {r"make fresh$": "test_fresh_examples_of_the_property_tests_pass"},
    "tests/test_design_page.py": {
        r"atpid design ": "test_the_worked_example_is_what_is_computed_now",
    },
    "tests/of_studies/test_analysis_coverage.py": {
        r"python -m studies\.identification\.analysis_coverage": "test_the_command_prints_its_table"
    },
    "tests/of_studies/test_identification_coverage.py": {
        r"python -m studies identification ": "test_the_command_puts_its_table_into_a_page"
    },
    "tests/of_studies/test_time_base.py": {
        r"python -m studies time-base": "test_the_command_puts_its_table_into_a_page"
    },
    "tests/of_studies/test_designs.py": {r"python -m studies designs": "test_the_command_prints_its_tables"},
    "tests/of_studies/test_dampers.py": {r"python -m studies dampers": "test_the_tables_are_printed"},
    "tests/of_studies/test_modal.py": {
        r"python -m studies modes": "test_a_structure_is_that_of_scipy_and_the_tables_show_what_a_mode_costs"
    },
    "tests/of_studies/test_peace01.py": {r"python -m studies peace01": "test_the_study_s_page_of_numbers"},
    "tests/test_campaign.py": {
        r"atpid (calibrate )?campaign": "test_a_campaign_killed_at_any_instant_loses_nothing_and_agrees_with_simulation"
    },
    "tests/test_emulated_stand.py": {
        r"make stand-emulated$": "test_the_emulated_stand_damps_as_the_simulated_bench_does",
        r"atpid standin": "test_the_emulated_stand_damps_as_the_simulated_bench_does",
        r"python -m atpid_driver\.nodes\.feed_node": "test_the_emulated_stand_damps_as_the_simulated_bench_does",
        r"atpid emulator ": "test_the_emulated_stand_damps_as_the_simulated_bench_does",
    },
    "tests/test_stop_chain.py": {
        r"python -m studies stop-chain": "test_ways_to_stop_end_with_the_motor_off_and_a_true_answer",
    },
    "atpid_control/test/test_import.py": {r"atpid bag import ": "test_the_examples_of_the_page_run"},
    "tests/test_howto_driver.py": {
        r"python -m atpid_driver\.nodes\.acquisition_node .*driver\.yaml": "test_its_samples_arrive",
    },
    "tests/test_howto_sensor.py": {
        r"python -m pytest -q test_load_cell\.py": "test_the_sensor_passes_the_contract",
        r"python -m pip install ": "test_its_samples_arrive",
        r"python -m atpid_driver\.nodes\.acquisition_node": "test_its_samples_arrive",
    },
    "tests/test_exciter_stops.py": {
        r"python -m studies exciter-stops": "test_a_stop_and_a_kill_end_with_the_output_off"
    },
    "tests/test_graph_excitation.py": {r"atpid excite ": "test_an_operator_excites_until_ctrl_c"},
    "tests/test_graph_real_time.py": {r"atpid bench .*--real-time": "test_nothing_is_lost_in_real_time"},
    "tests/test_howto_contact_law.py": {
        r"python -m pytest -q atpid_sim/test/test_contact\.py": "test_the_law_passes_the_general_tests"
    },
    "tests/test_live_page.py": {
        r"atpid bench .*--live": "test_the_page_shows_the_run",
        r"(python -m atpid_control\.nodes\.live_node|atpid live)": "test_a_page_alone_shows_that_there_is_no_graph",
    },
    # left out, and the tests say so, where there is no ros2 launch
    "tests/test_launch.py": {
        r"ros2 launch atpid_control bench\.launch\.py --show-args": "test_the_arguments_are_shown",
        r"ros2 launch atpid_control bench\.launch\.py scene": "test_the_bench_ends_with_its_run",
        r"ros2 launch atpid_control stand\.launch\.py": "test_the_stand_runs_until_ctrl_c",
        r"ros2 launch atpid_control replay\.launch\.py": "test_a_replay_is_recorded_in_the_folder_of_out",
    },
    "tests/test_replay.py": {r"ros2 run atpid_control replay_node": "test_ctrl_c_ends_a_replay_quietly"},
    "tests/test_replay_command.py": {
        r"atpid replay ": "test_a_bag_of_older_definitions_is_replayed_with_its_own_parameters"
    },
    "tests/test_without_ros2.py": {
        r"atpid stand ": "test_the_stand_runs_until_ctrl_c_and_its_bag_keeps_all_parameters",
        r"atpid ros lifecycle ": "test_a_motor_is_configured_and_activated_by_hand",
        r"python -m atpid_driver\.nodes\.motor_node": "test_a_motor_is_configured_and_activated_by_hand",
        r"atpid ros echo ": "test_the_messages_of_a_sensor_are_printed",
        r"python -m atpid_driver\.nodes\.labjack_node": "test_the_messages_of_a_sensor_are_printed",
        r"python -m atpid_control\.nodes\.replay_node": "test_a_replay_node_alone_logs_what_it_waits_for",
    },
    "tests/test_methods_page.py": {
        r"python -m studies methods( |$)": "test_the_table_shows_what_is_computed_now",
    },
    "tests/of_studies/test_planar.py": {
        r"python -m studies planar ": "test_the_study_puts_its_table_into_a_page",
    },
    "tests/of_studies/test_steady.py": {
        r"python -m studies steady ": "test_the_study_puts_its_table_into_a_page",
        r"atpid simulate scenes/standard.yaml --steady": "test_the_command_prints_it",
    },
    "tests/of_studies/test_sweep_steady.py": {
        r"atpid sweep ": "test_the_command_prints_and_writes_heights",
        r"python -m studies sweep .*--steady": "test_the_study_prints_both_speeds_and_the_judgement",
    },
    "tests/of_studies/test_off_resonance.py": {
        r"python -m studies off-resonance": "test_the_command_prints_one_object"
    },
    "tests/of_studies/test_selection_learned.py": {
        r"atpid learn ": "test_the_command_trains_a_model_that_selects",
    },
    "tests/test_security.py": {r"make policy$": "test_the_policy_is_that_of_the_nodes"},
    "tests/test_thesis_page.py": {
        r"python -m studies thesis list": "test_the_names_are_listed",
        r"python -m studies thesis ": "test_the_page_shows_what_is_computed_now",
    },
    "atpid_interfaces/atpid_common/test/test_param_command.py": {
        r"atpid ros param (set|get|describe)": "test_a_parameter_is_read_set_and_described",
    },
    "tests/of_studies/test_atlas.py": {
        r"python -m studies atlas ": "test_the_command_writes_data_tables_and_pictures",
    },
    "atpid_sim/test/test_basin.py": {
        r"atpid basin ": "test_the_command_prints_and_writes_heights",
        r"atpid simulate .*--kick": "test_simulate_states_it_beside_the_multipliers",
    },
    "atpid_sim/test/test_cli.py": {
        r"atpid simulate .*--series": "test_the_motion_is_written_and_can_drive_another_run",
        r"atpid simulate .*--height": "test_a_controlled_ceiling_is_refused_unless_a_height_is_given",
        r"atpid simulate ": "test_simulate_without_json_is_a_table_for_people",
        r"atpid map ": "test_map_writes_a_map_and_a_header",
    },
    "tests/of_studies/test_cliff_curves.py": {
        r"atpid cliffs ": "test_the_command_writes_table_and_picture",
    },
    "tests/of_studies/test_scene.py": {
        r"python -m studies figures scenes$": "test_the_documented_keys_are_those_that_are_checked"
    },
    "atpid_control/test/test_select_command.py": {r"atpid select ": "test_json_is_one_object_and_nothing_else"},
    "atpid_control/test/test_beam_calibration.py": {
        r"atpid calibrate beam .*--with-added": "test_two_recordings_through_the_command",
        r"atpid calibrate beam ": "test_the_command_writes_a_beam_block_a_scene_takes",
    },
    "atpid_control/test/test_contact_in_run.py": {
        r"atpid calibrate contact bags": "test_a_recorded_run_through_the_command",
    },
    "atpid_control/test/test_contact_calibration.py": {
        r"atpid calibrate contact .*force": "test_a_recorded_force_gives_restitution_and_modulus",
        r"atpid calibrate contact ": "test_the_command_writes_a_contact_block_a_scene_takes",
    },
    "atpid_control/test/test_modes_from_run.py": {
        r"atpid modes fit": "test_a_moving_support_shows_no_masses",
    },
    "atpid_control/test/test_modes.py": {
        r"atpid modes cantilever": "test_the_command_writes_blocks_that_it_explains",
        r"atpid modes file": "test_a_universal_file_gives_the_modes_it_was_written_from",
    },
    "atpid_control/test/test_export_formats.py": {
        r"atpid bag export .*csv": "test_csv_is_read_back_by_pandas_bit_by_bit",
        r"atpid bag export .*mat": "test_matlab_is_read_back_by_scipy_bit_by_bit",
        r"atpid bag export .*uff": "test_uff_58_is_read_back_by_pyuff_bit_by_bit",
    },
    "atpid_control/test/test_signal_analysis.py": {
        r"atpid bag analyse ": "test_the_command_writes_numbers_and_picture",
    },
    "atpid_control/test/test_bag_comparison.py": {
        r"atpid bag compare ": "test_the_command_compares_stages_and_writes_numbers_and_picture",
    },
    "atpid_control/test/test_recording.py": {
        r"atpid bag verify": "test_verify_prints_what_it_read",
        r"atpid bag repair": "test_what_is_no_bag_is_one_line",
        r"atpid bag extract": "test_what_a_bag_keeps_can_be_taken_out",
    },
    "atpid_control/test/test_recording_recover.py": {
        r"atpid bag recover": "test_nothing_is_written_over",
    },
    "atpid_control/test/test_recording_node.py": {
        r"ros2 run atpid_control recorder_node": "test_a_trigger_among_real_publishers",
    },
    "atpid_control/test/test_recording_check.py": {r"atpid bag check": "test_a_sound_run_is_one_line_and_status_0"},
    "tests/test_help.py": {r"python -m studies --help": "test_the_example_is_in_the_help_and_is_parsed"},
    "tests/test_stops.py": {r"python -m studies stops ": "test_random_interleavings_break_no_rule"},
    "tests/test_soak.py": {r"python -m studies soak ": "test_a_short_soak_runs_its_legs_and_leaves_nothing"},
    "tests/of_studies/test_selection_margin.py": {
        r"python -m studies selection-speed": "test_the_command_puts_its_table_into_a_page",
    },
    "tests/of_studies/test_random_selection.py": {
        r"python -m studies random-selection": "test_the_command_puts_its_table_into_a_page",
    },
    "atpid_driver/test/test_calibration.py": {
        r"atpid calibrate sensor ": "test_the_command_makes_a_file_and_a_picture",
        r"atpid calibrate reading ": "test_readings_are_taken_from_the_device",
    },
    "tests/of_studies/test_acquisition_load.py": {
        r"python -m studies load ": "test_every_scan_at_full_rate_arrives_or_is_counted"
    },
    "atpid_driver/test/test_acquisition_node.py": {
        r"ros2 run atpid_driver labjack_node": "test_interrupted_the_process_leaves_cleanly"
    },
    "atpid_driver/test/test_motor_process.py": {
        r"ros2 run atpid_driver motor_node": "test_ctrl_c_in_motion_stops_the_motor_at_once"
    },
    "tests/of_studies/test_faulty_line.py": {
        r"python -m studies storm": "test_the_real_firmware_keeps_its_limits_in_a_storm",
    },
    "tests/of_studies/test_firmware_frames.py": {
        r"make firmware$": "test_harmful_frames_move_nothing",
        r"make -C atpid_driver/firmware TABLE=": "test_lookup_takes_the_nearest_amplitude",
        r"python -m studies fuzz": "test_harmful_frames_move_nothing",
    },
}
#: Commands no test runs, and why. That ours exist and take the options shown is tested all the same.
NOT_RUN = {
    r"make test(-fast)?$": "it runs this",
    r"make coverage$": "it runs this, counting lines",
    r"make fuzz$": "an hour or two; test_fuzz_parsers.py and test_fuzz_arguments.py are a part of it",
    r"make mutations( |$)": "half an hour; test_mutations.py tests that each change can be made and has its tests",
    r"make lock$": "resolves against the package index; its results have a test",
    r"make audit$": "asks PyPI; the licences have a test in tests/test_security.py",
    r"ros2 (security|daemon)": "the wheels have no ros2, and no security in their middleware",
    r"make (parquet|import)$": "installs packages; .ci/run does it",
    r"make cpp$": "a minute of compiling; test_installation.py builds all of the messages",
    r"make docs$": "installs packages; test_docs_site.py builds the site with them",
    r"make wheel( |$)": "installs from the package index; test_wheel.py tries the wheel beside what is there",
    r"sudo make avr-tools$": "installs packages as root; .ci/run does it",
    r"sudo make browser$": "installs packages as root; .ci/run does it",
    r"make -C atpid_driver/firmware flash": "needs a board",
    r"python -m serial\.tools\.miniterm": "needs a board",
    r"python -m nidaqmx installdriver$": "installs NI's driver",
    r"python -m studies (tradeoff|extremes|sweep|seeds|campaign|figures \w)": "minutes; their parts have tests",
    r"(ros2( launch| run)?|python -m PACKAGE\.nodes\.NODE .*|ros2 run PACKAGE NODE .*)$": "a name in a sentence",
    r"ros2 lifecycle set NODE configure": "the wheels have no ros2",
    r"ros2 service call /supervisor_node/(rearm|stop)": "the wheels have no ros2; test_supervisor.py calls the service",
    r"ros2 service call /motor_node/rearm": "the wheels have no ros2; test_motor_node_serial.py calls the service",
    r"ros2 (lifecycle set /motor_node (configure|activate)|topic echo|bag( record)?$)": "the wheels have no ros2",
    r"ros2 param (set|describe|load)": "the wheels have no ros2",
    r"ros2 (run diagnostic_aggregator|pkg prefix)": "the wheels have neither; test_packages.py compares the analyzers",
}
#: Options of programs that are not ours.
FOREIGN_OPTIONS = {"--ros-args", "--params-file", "--show-args", "--symlink-install", "--enclave"}
#: Names of files that runs make, that the reader gives, or that belong to others.
MADE_OR_GIVEN = {
    "campaign.yaml", "model.yaml", "index.html", "index.json", "index.csv", "comparison.json", "point.json",
    "campaign.json", "digests.json",
    "my_beam.yaml", "amplitude.png", "my_map.npz", "height_map.png", "methods.json", "sweep.csv",
    "atpid_sim/atpid_sim/contact/hunt_crossley.py",
    "FILE.mcap", "MAP.npz", "READINGS.csv", "SCENE.yaml", "FILE.h", "readings.csv", "table.h", "beam.yaml",
    "scenes/a.yaml", "levels.yaml", "contact.yaml", "drop.csv", "force.csv",
    "scenes/NAME.yaml", "laser_support_A17.yaml", "bag_0.mcap", "run_0.mcap", "metadata.yaml", "parameters.yaml",
    "summary.json", "replay.json", "NODE.yaml", "report.html", "overview.png", "grain.png", "tradeoff.json",
    "atlas.npz", "atlas.csv", "atlas.json",
    "tradeoff.md", "tradeoff.png", "rows.json", "rows.csv", "support.csv", "agreement.json", "agreement.png",
    "design.html", "design.json", "design.png", "heights.npz",
    "scene.yaml", "stdint.h", "bench.yaml", "proportional_height.py", "test_proportional_height.py",
    "driver.py", "driver.yaml", "std_msgs.msg", "measured.csv", "load_cell.py", "test_load_cell.py", "force.yaml",
    "node.yaml", "soak.json", "soak.png", "FAULTS.yaml",
    "run.csv", "run.mat", "run.uff", "run.TOPIC.csv", "analysis.png", "analysis.json", "analysis.html",
    "bags.html",
}  # fmt: skip
_FILE = re.compile(
    r"(?<![\w/$.~-])[\w*./-]*\w\.(?:py|md|yaml|npz|cpp|h|toml|msg|srv|action|png|json|csv|html|mcap)(?![\w.(])"
)
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")


def ours() -> list[Piece]:
    """Return the documented commands of the project's own programs."""
    return [piece for piece in commands() if piece.text.startswith(("atpid ", "python -m studies "))]


@functools.cache
def help_of(program: str, words: tuple[str, ...]) -> str:
    """Return what a program prints with `words` and --help."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        (atpid if program == "atpid" else studies)([*words, "--help"])
    return printed.getvalue()


def help_for(command: str) -> str:
    """Return the help of the command that a documented line uses."""
    program, rest = ("atpid", command[6:]) if command.startswith("atpid ") else ("studies", command[18:])
    words = rest.split()
    table = ATPID if program == "atpid" else STUDIES
    names = {tuple(name.split()) for group in table.values() for name in group}
    used = next((tuple(words[:n]) for n in (2, 1) if tuple(words[:n]) in names), ())
    return help_of(program, used)


def patterns() -> list[str]:
    return [pattern for tests in RUN.values() for pattern in tests] + list(NOT_RUN)


def test_every_documented_command_is_run_or_there_is_a_reason() -> None:
    known = re.compile("|".join(patterns()))
    assert [piece for piece in commands() if not known.match(piece.text)] == []


def test_the_tests_named_for_commands_exist() -> None:
    named = [(file, name) for file, tests in RUN.items() for name in tests.values()]
    assert [place for place in named if f"def {place[1]}(" not in (ROOT / place[0]).read_text()] == []


def test_every_pattern_is_needed() -> None:
    typed = [piece.text for piece in commands()]
    assert [pattern for pattern in patterns() if not any(re.match(pattern, text) for text in typed)] == []


@pytest.mark.parametrize("piece", sorted(set(ours())), ids=lambda piece: piece.text[10:60])
def test_the_command_is_there_and_takes_these_options(piece: Piece) -> None:
    printed = help_for(piece.text)
    assert printed.startswith("usage: "), piece
    assert [option for option in _OPTION.findall(piece.text) if option not in printed] == []


def test_every_option_mentioned_belongs_to_a_command() -> None:
    known = FOREIGN_OPTIONS | {option for piece in ours() for option in _OPTION.findall(help_for(piece.text))}
    mentioned = [
        (piece.page, option)
        for piece in pieces()
        if piece.text.startswith("--")
        for option in _OPTION.findall(piece.text)
    ]
    assert [(page, option) for page, option in mentioned if option not in known] == []


def test_every_make_target_exists() -> None:
    for piece in commands():
        words = piece.text.removeprefix("sudo ").split()
        if words[0] != "make":
            continue
        folder = Path(words[words.index("-C") + 1]) if "-C" in words else Path()
        targets = re.findall(r"^([a-z-]+):", (ROOT / folder / "Makefile").read_text(), flags=re.MULTILINE)
        named = [word for word in words[1:] if "=" not in word and word not in ("-C", str(folder))]
        assert set(named) <= set(targets), piece


def test_every_file_mentioned_exists() -> None:
    there = [f"/{path.relative_to(ROOT)}" for path in files()]

    def known(name: str) -> bool:
        if name in MADE_OR_GIVEN or name.startswith(("out/", "/", "KEPT/", "path/to/")):
            return True
        return bool(fnmatch.filter(there, f"*/{name.removeprefix('./')}"))

    mentioned = {(piece.page, name) for piece in pieces() for name in _FILE.findall(piece.text)}
    assert sorted((page, name) for page, name in mentioned if not known(name)) == []


def test_every_module_mentioned_exists() -> None:
    names = {(piece.page, name) for piece in pieces() for name in re.findall(r"\batpid_\w+(?:\.\w+)+", piece.text)}
    dotted = [(page, name) for page, name in names if not _FILE.search(name) and not name.endswith("npz")]
    assert sorted((page, name) for page, name in dotted if not exists(name)) == []


@pytest.mark.parametrize(
    "page", [p for p in files() if p.suffix == ".md"], ids=lambda path: str(path.relative_to(ROOT))
)
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for target in links(page):
        name, _, anchor = target.partition("#")
        place = (page.parent / name).resolve() if name else page
        if not place.exists() or (anchor and anchor not in anchors(place)):
            broken.append(target)
    assert broken == []


def test_the_index_names_every_page() -> None:
    index = {(ROOT / "docs" / target.partition("#")[0]).resolve() for target in links(ROOT / "docs/README.md")}
    assert [
        page.name for page in PAGES if page.parent.name == "docs" and page.name != "README.md" and page not in index
    ] == []


@pytest.mark.slow
def test_the_report_of_the_recorded_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from atpid_control.cli import main

    bag = ROOT / "bags/thesis_4_3_short"
    assert main(["bag", "report", str(bag), "--out", str(tmp_path / "report")]) == 0
    assert str(tmp_path / "report" / "report.html") in capsys.readouterr().out
    assert (tmp_path / "report" / "overview.png").is_file()
