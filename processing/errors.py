"""Errors of processing. Exit codes: 5 a stage failed · 2 usage · 4 session · 6 resource (see `station.errors`)."""

from __future__ import annotations

from drivers.errors import DaylitError
from station.errors import SessionError, UsageError


class ProcessingError(DaylitError):
    """A stage cannot give what it should."""

    code = "PRC-000"
    exit_code = 5


class ParameterError(UsageError):
    """A parameter or an option that cannot be right; names it and its range."""

    code = "USE-004"


class ChoicesError(SessionError):
    """choices.toml of a session cannot be right, or names a file that is not there; it is left as it is."""

    code = "SES-011"


class PictureFileError(ProcessingError):
    """A picture file that is damaged, of the wrong kind, or holds values that light cannot have; names the file."""

    code = "PIC-001"


class PanoramaError(PictureFileError):
    """A picture that is no whole equirectangular panorama: another shape or projection, a part, to be turned."""

    code = "PIC-002"


class ResponseError(ProcessingError):
    """Frames from which no response curve can be recovered: too few, all alike, all clipped or all dark."""

    code = "CAL-001"


class BracketError(ProcessingError):
    """Frames that cannot be one bracket: sizes, types or exposures that do not fit together."""

    code = "CAL-002"


class ScaleError(ProcessingError):
    """No absolute scale: no usable meter reading, no target in the picture, or a target that is clipped or dark."""

    code = "CAL-003"


class ChartError(ProcessingError):
    """The chart was not found, or what was found is not the chart."""

    code = "CAL-004"


class ProfileError(ProcessingError):
    """A calibration profile that cannot be read, or belongs to another camera or to other settings."""

    code = "CAL-005"


class LensError(ProcessingError):
    """A lens model or an image circle that cannot be right."""

    code = "CAL-006"


class SunError(ProcessingError):
    """The sun was needed and was not found, or is where the time and the site say it cannot be."""

    code = "CAL-007"


class LayoutError(ProcessingError):
    """Furniture cannot be arranged as asked."""

    code = "LAY-000"


class PlanError(LayoutError):
    """A floor plan that cannot be right: self-crossing (the crossing named), open, no area, an opening off its wall."""

    code = "LAY-001"


class RoomTooSmallError(LayoutError):
    """The room cannot hold the largest item asked for, in any position."""

    code = "LAY-002"


class NoDoorError(LayoutError):
    """The room has no door, so that no path through it can be checked."""

    code = "LAY-003"


class ItemError(LayoutError):
    """An unknown item (the nearest names are suggested), or one whose size cannot be right."""

    code = "LAY-004"
    exit_code = 2


class RulesError(LayoutError):
    """A rules file that cannot be read, or a rule set that is not in it; the key is named."""

    code = "LAY-005"
    exit_code = 2


class PinError(LayoutError):
    """A pinned item that breaks a hard rule where it stands, or is not among the items."""

    code = "LAY-006"
    exit_code = 2


class ModelFileError(LayoutError):
    """A furniture file that cannot be read or holds no furniture: damaged, too large, outside its folder."""

    code = "LAY-007"


class CatalogueError(LayoutError):
    """A folder that is no catalogue, a model that is not in it, or a size that a model cannot be made in."""

    code = "LAY-008"
    exit_code = 2


class RoomError(ProcessingError):
    """A room that cannot be: floor, heights or openings that do not fit; names every key."""

    code = "ROO-001"


class SegmenterError(ProcessingError):
    """A segmentation network that cannot be loaded, or does not keep the contract that was declared for it."""

    code = "SEG-001"


class ModelError(ProcessingError):
    """A model of the list that cannot be fetched or kept, is not installed, or a file that is none of them."""

    code = "SEG-002"


class RenderingError(ProcessingError):
    """A picture cannot be rendered as asked."""

    code = "REN-000"


class SceneError(RenderingError):
    """A scene that cannot be: broken meshes, no surfaces, an outdoor picture of the wrong shape."""

    code = "REN-001"


class MaterialError(RenderingError):
    """An albedo, a texture, a transmittance or an emission that light cannot have; names the surface."""

    code = "REN-002"


class NoBalanceError(RenderingError):
    """Light that is never absorbed: a closed scene of albedo 1 with a source in it."""

    code = "REN-003"


class EngineError(RenderingError):
    """The renderer asked for cannot be had: no ray tracer works here, or the one named is unknown."""

    code = "REN-004"
    exit_code = 2


class AlbedoError(RenderingError):
    """Albedo cannot be estimated: no light in the picture, or no visible surface."""

    code = "REN-005"


class RelightError(RenderingError):
    """Another light cannot be worked out: a basis of another scene or version, or one too large to be held."""

    code = "REN-006"


class ViewpointError(RenderingError):
    """A place from which the room cannot be looked at: outside of it, or within a piece of furniture (named)."""

    code = "REN-007"


class DaylightError(ProcessingError):
    """The light at another time cannot be computed: no site or heading, or the sun is below the horizon."""

    code = "DAY-001"


class NoRoomError(ProcessingError):
    """A picture that shows no room that could be estimated: black, cropped, not a panorama, or outdoors."""

    code = "ROO-002"


class LayoutFileError(ProcessingError):
    """A room layout in another program's format that is damaged, or is no room."""

    code = "ROO-003"


class LayoutNetworkError(ProcessingError):
    """A layout network that cannot be loaded, or whose inputs and outputs are not what its kind has."""

    code = "ROO-004"


class FillerError(ProcessingError):
    """A filling network that cannot be loaded, or whose inputs and outputs are not what the contract asks."""

    code = "RMV-001"


class RemovalError(ProcessingError):
    """A room that cannot be emptied: what is to be removed covers all that is seen."""

    code = "RMV-002"


class ClusterError(ProcessingError):
    """No Dask cluster at the address given, or none that can be made here."""

    code = "BAT-001"
    exit_code = 6


class SessionKilledError(ProcessingError):
    """The process that worked on a session was ended by a signal, twice."""

    code = "BAT-002"


class SessionTimeoutError(ProcessingError):
    """A session that was not done in the time allowed."""

    code = "BAT-003"


class WorkerLostError(ProcessingError):
    """The workers that had a session ended, or failed, while they had it."""

    code = "BAT-004"


class StoreError(ProcessingError):
    """An object store that does not answer, or holds what should not be there."""

    code = "BAT-005"
