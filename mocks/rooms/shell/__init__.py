"""Everything of a room that is not furniture, as meshes: walls with their openings, frames, doors and fixtures.

The shell is light-tight: light enters through the panes of `window_panes` and nowhere else. Panes have no mesh.
"""

from mocks.rooms.model import Finish, Part, Plan
from mocks.rooms.shell.fixtures import fixture_parts
from mocks.rooms.shell.openings import door_parts, window_parts
from mocks.rooms.shell.surfaces import floor_and_ceiling, mouldings, walls


def shell_parts(plan: Plan, finish: Finish) -> list[Part]:
    """Return shell and fixtures of a room, in its coordinates (metres)."""
    makers = (floor_and_ceiling, walls, mouldings, window_parts, door_parts, fixture_parts)
    return [part for make in makers for part in make(plan, finish)]
