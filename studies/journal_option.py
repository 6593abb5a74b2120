# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The option of a study that can be taken up again."""

import argparse

from atpid_common.arguments import file_path


def add_journal(parser: argparse.ArgumentParser) -> None:
    """Declare --journal, for a command without a folder or file of its own where a journal could lie."""
    text = "keep what is done in this file, and go on from it after a kill; removed at the end"
    parser.add_argument("--journal", type=file_path, metavar="FILE", help=text)
