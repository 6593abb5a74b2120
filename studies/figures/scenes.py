# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/scenes.md, read off the models that check a scene.

python -m studies figures scenes
"""

from atpid_sim.fields import SceneBlock, variants_of
from atpid_sim.scene import Scene
from atpid_sim.scene.ceiling import Ceiling
from atpid_sim.scene.drives import Random, Shock, Tone
from atpid_sim.scene.excitation import Excitation, FreeDecay, Series, Sweep
from atpid_sim.scene.faults import Fault
from atpid_sim.scene.model import ContactBlock
from atpid_sim.scene.sensors import Recording, Sensor, Sensors
from atpid_sim.scene.structure import Beam, Container, FurtherMode, Grain, Initial

_PARTS: dict[str, list[type[SceneBlock]]] = {
    "The scene": [Scene],
    "`beam`": [Beam],
    "`further_modes`: a list of": [FurtherMode],
    "`grain`": [Grain],
    "`container`": [Container],
    "`contact`: one of": list(variants_of(ContactBlock).values()),
    "`excitation`: one of": [*variants_of(Excitation).values(), FreeDecay, Sweep, Series, Tone, Random, Shock],
    "`ceiling`: one of": list(variants_of(Ceiling).values()),
    "`initial`": [Initial],
    "`sensors`": [Sensors, Sensor],
    "`recording`": [Recording],
    "`faults`: a list of": [Fault],
}


def schema_tables() -> str:
    """Return one Markdown table per block: key, whether it may be left out, meaning."""
    lines: list[str] = []
    for title, models in _PARTS.items():
        lines += [f"### {title}", ""]
        for model in models:
            if len(models) > 1:
                lines += [f"**{_title(model)}.** {str(model.__doc__).strip().splitlines()[0]}", ""]
            lines += ["| key | needed | meaning |", "|---|---|---|", *_rows(model), ""]
    return "\n".join(lines).strip()


def _rows(model: type[SceneBlock]) -> list[str]:
    rows = []
    for name, field in model.model_fields.items():
        needed = "yes" if field.is_required() else "no"
        meaning = field.description or f"`{_title(model)}`"
        if needed == "no" and "default" not in meaning and not isinstance(field.default, SceneBlock):
            meaning += f"; default: {'none' if field.default is None else field.default}"
        rows.append(f"| `{field.alias or name}` | {needed} | {meaning} |")
    return rows + [f"| `{name}` | instead | {meaning} |" for name, meaning in model.alternatives.items()]


def _title(model: type[SceneBlock]) -> str:
    law = model.model_fields.get("law")
    if law is not None:
        return str(law.annotation).rpartition("[")[2].strip("]'\"")
    return model.__name__.removesuffix("Ceiling").removesuffix("Excitation")
