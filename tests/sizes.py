# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How large the project is, beside the most it may be (budgets.yaml): `python tests/sizes.py`; status 1: larger.

`--routes` lists the files to read before one changes a contact law, a decision, the stop path or a report.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import yaml
from inventory import inventory

ROOT = Path(__file__).resolve().parent.parent
CORE = ("atpid_interfaces/atpid_common/atpid_common", "atpid_sim/atpid_sim", "atpid_driver/atpid_driver",
        "atpid_control/atpid_control")  # fmt: skip
#: Pages that are made from the code, or that list what is elsewhere.
MADE = {"changes.md", "commands.md", "messages.md", "python_api.md"}


def _files(folder: Path, *places: str) -> list[Path]:
    return sorted(path for place in places for path in folder.glob(f"{place}/**/*.py"))


def _lines(paths: list[Path]) -> int:
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def _body(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function below its docstring."""
    rest = function.body[1:] if ast.get_docstring(function) is not None else function.body
    return (rest[-1].end_lineno or 0) - rest[0].lineno + 1 if rest else 0


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def _names(tree: ast.Module) -> set[str]:
    """Return the names that a module defines at its top."""
    found = {node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef)}
    for node in tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
    return found


def _kept_to_their_room(folder: Path) -> set[str]:
    """Return the modules that import rules keep to their room, as in "atpid_sim.engine.beam"."""
    lists = re.findall(
        r"^protected_modules = \[(.*?)^\]", (folder / "pyproject.toml").read_text(), re.DOTALL | re.MULTILINE
    )
    return set(re.findall(r'"(.*?)"', "".join(lists)))


def sizes(folder: Path = ROOT) -> dict[str, int]:
    """Return the size of the project in `folder` by the names of budgets.yaml."""
    core, extensions = _files(folder, *CORE), _files(folder, "extensions/*/atpid_*")
    product = [*core, *extensions]
    texts = [path.read_text(encoding="utf-8") for path in product]
    trees = [ast.parse(text) for text in texts]
    functions = [(function, place) for place, tree in enumerate(trees) for function in _functions(tree)]
    uses = [Counter(re.findall(r"\w+", text)) for text in texts]
    private = [(function, place) for function, place in functions if re.match(r"_(?!_)", function.name)]
    kept = {name.replace(".", "/") for name in _kept_to_their_room(folder)}
    open_trees = [
        tree
        for path, tree in zip(product, trees, strict=True)
        if not any(path.with_suffix("").as_posix().endswith(f"/{name}") for name in kept)
    ]
    pages = [path for path in folder.glob("docs/*.md") if path.name not in MADE]
    return {
        "lines of the core": _lines(core),
        "lines of extensions": _lines(extensions),
        "lines of studies": _lines(_files(folder, "studies")),
        "lines of tests": inventory(folder).lines,
        "files": len(product),
        "functions": len(functions),
        "public names": sum(not name.startswith("_") for tree in open_trees for name in _names(tree)),
        "functions of at most 3 lines used once": sum(
            _body(function) <= 3 and uses[place][function.name] == 2 for function, place in private
        ),
        "`fmt: skip`": sum(text.count("# fmt: skip") for text in texts),
        "lines with Any": sum(bool(re.search(r"\bAny\b", line)) for text in texts for line in text.splitlines()),
        "files under 40 lines": sum(text.count("\n") < 40 for text in texts),
        "words of the pages for users": sum(len(path.read_text(encoding="utf-8").split()) for path in pages),
        **{f"lines to read for {route}": sum(files.values()) for route, files in routes(folder).items()},
    }


def budgets() -> dict[str, int]:
    """Return the most there may be of each."""
    read: dict[str, int] = yaml.safe_load((ROOT / "tests/budgets.yaml").read_text(encoding="utf-8"))
    return read


def routes(folder: Path = ROOT) -> dict[str, dict[str, int]]:
    """Return, for each way through the code (routes.yaml), its files with their lines."""
    read: dict[str, list[str]] = yaml.safe_load((folder / "tests/routes.yaml").read_text(encoding="utf-8"))
    return {name: {path: _lines([folder / path]) for path in paths} for name, paths in read.items()}


def main() -> int:
    """Print each size beside its budget; return 1 where one is exceeded, else 0."""
    if sys.argv[1:] == ["--routes"]:
        for route, files in routes().items():
            print(f"{route}: {len(files)} files, {sum(files.values())} lines")
            print(*(f"{lines:7}  {path}" for path, lines in files.items()), sep="\n")
        return 0
    found, most = sizes(*map(Path, sys.argv[1:2])), budgets()
    for name, size in found.items():
        print(f"{size:7} of {most[name]:7}  {name}{'  EXCEEDED' if size > most[name] else ''}")
    return int(any(size > most[name] for name, size in found.items()))


if __name__ == "__main__":
    sys.exit(main())
