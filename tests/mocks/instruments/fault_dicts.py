"""Faults as flat, JSON-able mappings, as a person writes them and reports show them::

{"kind": "unplug", "operation": 0x101B, "nth": 2, "phase": "data", "byte": 700, "replug_after_s": 2.0}
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mocks.instruments.faults import Fault, FaultKind, Moment, Phase


def dict_of(fault: Fault) -> dict[str, Any]:
    return {
        "kind": str(fault.kind),
        fault.moment.value: fault.code,
        "nth": fault.nth,
        "times": fault.times,
        "phase": str(fault.phase),
        "byte": fault.byte,
        **fault.parameters,
    }


def fault_of(data: Mapping[str, Any]) -> Fault:
    """Return the fault; `ValueError` names what is wrong with it."""
    rest = dict(data)
    kind = FaultKind(rest.pop("kind"))
    phase = Phase(rest.pop("phase", Phase.RESPONSE))
    code = [int(rest.pop(m.value)) for m in Moment if m.value in rest]
    if len(code) > 1:
        raise ValueError(f"fault {kind} names more than one trigger")
    numbers = {name: int(rest.pop(name)) for name in ("nth", "times", "byte") if name in rest}
    fault = Fault(kind, code[0] if code else 0, phase=phase, parameters=rest, **numbers)
    if code and fault.moment.value not in data:
        raise ValueError(f"fault {kind} is triggered by {fault.moment}")
    return fault
