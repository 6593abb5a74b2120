# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the page may ask for: one request of a browser, checked where it comes in."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from atpid_control.views.live.address import LiveError

#: Longest note [characters], and longest request [bytes].
NOTE, LONGEST = 200, 4096


class _Request(BaseModel):
    """The number is given back with the answer."""

    model_config = ConfigDict(extra="forbid", strict=True)
    number: int = Field(ge=0, lt=2**53)


class Plain(_Request):
    """Stop: all off, latched. Disarm: motor off. Arm: clear a stop and arm the motor, homing where needed."""

    do: Literal["stop", "disarm", "arm", "arm_exciter"]


class HoldRequest(_Request):
    """Hold the ceiling where it is, or end the hold."""

    do: Literal["hold"]
    on: bool


class MethodRequest(_Request):
    """Choose the method of selection."""

    do: Literal["method"]
    name: Annotated[str, StringConstraints(min_length=1, max_length=100)]


class Note(_Request):
    """Mark the record with a line of text."""

    do: Literal["note"]
    text: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=NOTE)]


Request = Plain | HoldRequest | MethodRequest | Note
_ADAPTER: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def read_request(text: str | bytes) -> Request:
    """Return the request in a message of a browser; raise LiveError, in one line, where it is none."""
    try:
        request = _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"][1:])) or "request"
        raise LiveError(f"{where}: {first['msg']}") from None
    if isinstance(request, Note) and not request.text.isprintable():
        raise LiveError("text: allowed: one line of printable characters")
    return request
