# SPDX-License-Identifier: Apache-2.0
"""The launch files name nodes, parameter files and arguments that exist.

`launch` is not among the wheels: where it cannot be imported, stand-ins that only note their arguments take its place.
"""

import importlib.util
import runpy
import sys
from importlib.metadata import entry_points
from types import ModuleType, SimpleNamespace

import pytest

NAMES = {
    "launch": ["LaunchDescription"],
    "launch.actions": ["DeclareLaunchArgument", "Shutdown"],
    "launch.conditions": ["IfCondition"],
    "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
    "launch_ros.parameter_descriptions": ["ParameterValue"],
    "launch_ros.substitutions": ["FindPackageShare"],
}


def noting(name):
    return lambda *args, **kwargs: SimpleNamespace(kind=name, args=args, **kwargs)


@pytest.fixture
def stand_ins(monkeypatch):
    for module, names in NAMES.items():
        made = ModuleType(module)
        for name in names:
            setattr(made, name, noting(name))
        monkeypatch.setitem(sys.modules, module, made)


def described(path):
    entities = runpy.run_path(str(path))["generate_launch_description"]().args[0]
    return [item for item in entities if item.kind == "Node"], [item for item in entities if item.kind != "Node"]


def config_of(value):
    """Return (package, file) of a parameter file."""
    share, folder, name = value.args[0]
    assert folder == "config"
    return share.args[0], name


EXPECTED = {
    "bench": {"plant_node", "identifier_node", "selector_node", "motor_node", "recorder_node"},
    "stand": {"labjack_node", "ni_node", "identifier_node", "selector_node", "motor_node", "recorder_node"},
}


@pytest.mark.parametrize("name", EXPECTED)
def test_nodes_and_parameter_files_exist(name, root, stand_ins):
    nodes, arguments = described(root / "atpid_control" / "launch" / f"{name}.launch.py")
    assert {node.executable for node in nodes} == EXPECTED[name]
    scripts = {(script.dist.name.replace("-", "_"), script.name) for script in entry_points(group="console_scripts")}
    assert {(node.package, node.executable) for node in nodes} <= scripts
    defaults = [item.default_value for item in arguments if not isinstance(getattr(item, "default_value", ""), str)]
    files = [item for node in nodes for item in node.parameters if getattr(item, "kind", "") == "PathJoinSubstitution"]
    for package, file in map(config_of, files + defaults):
        assert (root / package / "config" / file).is_file()


@pytest.mark.parametrize("name", EXPECTED)
def test_every_argument_used_is_declared_and_described(name, root, stand_ins):
    path = root / "atpid_control" / "launch" / f"{name}.launch.py"
    _, arguments = described(path)
    declared = {item.args[0] for item in arguments}
    used = {word for word in declared if f'"{word}"' in path.read_text().replace(f'DeclareLaunchArgument("{word}"', "")}
    assert declared == {"scene", "map", "bag"} | (declared & {"motor_config", "labjack_config", "ni_config", "ni"})
    assert all(item.description for item in arguments)
    assert {"scene", "map", "bag"} <= used


@pytest.mark.parametrize("name", EXPECTED)
def test_the_real_launch_takes_the_file_where_there_is_one(name, root):
    path = root / "atpid_control" / "launch" / f"{name}.launch.py"
    if importlib.util.find_spec("launch_ros") is None:
        compile(path.read_text(), str(path), "exec")
    else:
        assert runpy.run_path(str(path))["generate_launch_description"]().entities
