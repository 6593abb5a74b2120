# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/howto_driver.md as a reader follows it: a driver of another package, the node, and what it publishes."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
import yaml
from documented import ROOT

from atpid_control.stand.domain import own_domain

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "howto_driver.md").read_text(encoding="utf-8")
#: A block of code, and the file named before it.
FILE = re.compile(r"`([\w.]+\.(?:py|yaml))`(?:(?!```).)*?^```\w+\n(.*?)^```", re.DOTALL | re.MULTILINE)
DRIVER, NODE, ECHO = (line.split() for line in PAGE.splitlines() if line.startswith(("    python ", "    atpid ")))


@pytest.mark.timeout(300)
def test_its_samples_arrive(tmp_path: Path) -> None:
    for name, text in FILE.findall(PAGE):
        (tmp_path / name).write_text(text)
    assert {path.name for path in tmp_path.iterdir()} == {"driver.py", "driver.yaml"}
    with own_domain() as number:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(number)}
        running = [
            subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
            for command in (DRIVER, NODE)
        ]
        try:
            done = subprocess.run(ECHO, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        finally:
            for one in running:
                one.send_signal(signal.SIGINT)
                one.communicate(timeout=100.0)
    assert done.returncode == 0, done.stderr
    block = yaml.safe_load(done.stdout.removesuffix("---\n"))
    assert (block["device"], block["units"]) == ("their/data:0", ["m/s^2", "m/s^2"])
    assert block["rate"] == pytest.approx(200.0, rel=0.02)
    assert max(map(abs, block["data"])) <= 98.1
    assert block["data"][0] == -block["data"][1]
