# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The keys of docs/scenes.md, read off the models that check a scene.

python -m studies figures scenes
"""

from atpid_sim.contact.spec import ElasticSpec
from atpid_sim.fields import SceneBlock, variants_of
from atpid_sim.scene import Scene
from atpid_sim.scene.ceiling import Ceiling
from atpid_sim.scene.drives import Random, Shock, Tone
from atpid_sim.scene.excitation import CommandedExcitation, Excitation, FreeDecay, HarmonicExcitation, Series, Sweep
from atpid_sim.scene.model import ContactBlock
from atpid_sim.scene.sensors import Fault, Recording, Sensor, Sensors
from atpid_sim.scene.structure import Beam, Container, FurtherMode, Grain, Initial

#: What stands in the blocks of excitations of one key.
_INNER: dict[str, type[SceneBlock]] = {
    "free": FreeDecay,
    "sweep": Sweep,
    "series": Series,
    "tones": Tone,
    "random": Random,
    "shock": Shock,
}
_EXCITATIONS = sorted(variants_of(Excitation).values(), key=lambda model: model is not HarmonicExcitation)
_PARTS: dict[str, list[type[SceneBlock]]] = {
    "The scene": [Scene],
    "`beam`": [Beam],
    "`further_modes`: a list of": [FurtherMode],
    "`grain`": [Grain],
    "`container`": [Container],
    "`contact`: `law` and the keys of one of": [ElasticSpec, *variants_of(ContactBlock).values()],
    "`excitation`: one of": _EXCITATIONS,
    "`ceiling`: one of": list(variants_of(Ceiling).values()),
    "`initial`": [Initial],
    "`sensors`": [Sensors, Sensor],
    "`recording`": [Recording],
    "`faults`: a list of": [Fault],
}


def key_lists() -> str:
    """Return one Markdown list per block: key and meaning, with unit and default."""
    lines: list[str] = []
    for title, models in _PARTS.items():
        lines += [f"### {title}", ""]
        for model in models:
            text = str(model.__doc__).strip().splitlines()[0]
            lines += [f"**{_title(model)}.** {text}", ""] if len(models) > 1 else []
            rows = _rows(model)
            lines += [*rows, ""] if rows else []
    return "\n".join(lines).strip()


def _rows(model: type[SceneBlock]) -> list[str]:
    """Return a line for each key; of a block in a block, and of a law after Hertz, of what it has of its own."""
    inner = next((_INNER[name] for name in model.model_fields if model in _EXCITATIONS and name in _INNER), None)
    if inner is not None:
        return _rows(inner)
    shared = model is not ElasticSpec and issubclass(model, ElasticSpec)
    left_out = {"law"} | ({*ElasticSpec.model_fields, *ElasticSpec.alternatives} if shared else set())
    if model is CommandedExcitation:
        left_out |= set(HarmonicExcitation.model_fields)
    rows = []
    for name, field in model.model_fields.items():
        meaning = field.description or f"`{_title(model)}`"
        if not field.is_required() and "default" not in meaning:
            default = "none" if field.default in (None, ()) else field.default
            meaning += "; optional" if isinstance(field.default, SceneBlock) else f"; default: {default}"
        rows += [f"- `{field.alias or name}`: {meaning}"] if name not in left_out else []
    return rows + [f"- `{name}`: {text}" for name, text in model.alternatives.items() if name not in left_out]


def _title(model: type[SceneBlock]) -> str:
    if model is ElasticSpec:
        return "Shared by hertz, lee_herrmann, kuwabara_kono and tsuji"
    law = model.model_fields.get("law")
    if law is not None:
        return str(law.annotation).rpartition("[")[2].strip("]'\"")
    inner = next((name for name in model.model_fields if model in _EXCITATIONS and name in _INNER), None)
    return f"`{inner}`" if inner else model.__name__.removesuffix("Ceiling").removesuffix("Excitation")
