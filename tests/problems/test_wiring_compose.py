"""A fault's lines become those of the problem file at hand: composed with what it says of the columns already."""

from __future__ import annotations

import pytest

from onlinebayes.problems.wiring_lines import composed

SIGN = '[signals."qpos.a"]\nsign = -1'
SWAP = '[signals."qpos.a"]\ncolumn = "qpos.b"\n[signals."qpos.b"]\ncolumn = "qpos.a"'
COMMANDS = '[commands.u]\ncolumn = "ctrl.v"\n[commands.v]\ncolumn = "ctrl.u"'


def signals(**tables: dict[str, object]) -> dict[str, object]:
    return {"signals": {f"qpos.{name}": table for name, table in tables.items()}}


@pytest.mark.parametrize(
    ("lines", "content", "expected"),
    [
        (SIGN, {}, SIGN),
        (SIGN, signals(a={"sd": 1e-3}), SIGN),
        (SIGN, signals(a={"sign": -1}), '[signals."qpos.a"]\nsign = 1'),
        (SIGN, signals(a={"offset": 0.5}), '[signals."qpos.a"]\noffset = -0.5\nsign = -1'),
        ("[commands.u]\nscale = 0.001", {"commands": {"u": {"scale": 2.0}}}, "[commands.u]\nscale = 0.002"),
        ('[signals."qpos.a"]\noffset = 0.25', signals(a={"offset": 0.5}), '[signals."qpos.a"]\noffset = 0.75'),
        ('[signals."qpos.a"]\nlatency = 0.01', signals(a={"latency": 0.02}), '[signals."qpos.a"]\nlatency = 0.03'),
        (SWAP, {}, SWAP.replace("\n[", "\n\n[")),
        (
            SWAP,
            signals(a={"column": "left", "unit": "deg"}, b={"column": "right", "sign": -1}),
            '[signals."qpos.a"]\ncolumn = "right"\nsign = -1\nunit = "rad"\n\n'
            '[signals."qpos.b"]\ncolumn = "left"\nunit = "deg"\nsign = 1',
        ),
        (COMMANDS, {}, COMMANDS.replace("\n[", "\n\n[")),
        (
            COMMANDS,
            {"commands": {"u": {"column": "action[0]"}, "v": {"column": "action[1]"}}},
            '[commands.u]\ncolumn = "action[1]"\n\n[commands.v]\ncolumn = "action[0]"',
        ),
        (f'{SIGN}\n[signals."qpos.a"]\nscale = 2.0', {}, '[signals."qpos.a"]\nsign = -1\nscale = 2.0'),
        ("[actuators.u]\ngravity_compensation = true", {}, "[actuators.u]\ngravity_compensation = true"),
        ("# in the table: a column enable.u", {}, "# in the table: a column enable.u"),
    ],
)
def test_lines_of_a_file(lines: str, content: dict[str, object], expected: str) -> None:
    assert composed(lines, content) == expected
