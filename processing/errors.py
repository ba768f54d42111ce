"""Errors of processing. Exit codes: 5 a stage failed · 2 usage · 4 session · 6 resource (see `station.errors`)."""

from drivers.errors import DaylitError
from station.errors import SessionError, UsageError


class ProcessingError(DaylitError, code="PRC-000", exit_code=5):
    """A stage cannot give what it should."""


class ParameterError(UsageError, code="USE-004"):
    """A parameter or an option that cannot be right; names it and its range."""


class ChoicesError(SessionError, code="SES-011"):
    """choices.toml of a session cannot be right, or names a file that is not there; it is left as it is."""


class ResultFileError(ProcessingError, code="PRC-001"):
    """A file of a stage's result that is missing, damaged or changed; names it, and what makes it anew."""


class PictureFileError(ProcessingError, code="PIC-001"):
    """A picture file that is damaged, of the wrong kind, or holds values that light cannot have; names the file."""


class PanoramaError(PictureFileError, code="PIC-002"):
    """A picture that is no whole equirectangular panorama: another shape or projection, a part, to be turned."""


class ResponseError(ProcessingError, code="CAL-001"):
    """Frames from which no response curve can be recovered: too few, all alike, all clipped or all dark."""


class BracketError(ProcessingError, code="CAL-002"):
    """Frames that cannot be one bracket: sizes, types or exposures that do not fit together."""


class ScaleError(ProcessingError, code="CAL-003"):
    """No absolute scale: no usable meter reading, no target in the picture, or a target that is clipped or dark."""


class ChartError(ProcessingError, code="CAL-004"):
    """The chart was not found, or what was found is not the chart."""


class ProfileError(ProcessingError, code="CAL-005"):
    """A calibration profile that cannot be read, or belongs to another camera or to other settings."""


class LensError(ProcessingError, code="CAL-006"):
    """A lens model or an image circle that cannot be right."""


class SunError(ProcessingError, code="CAL-007"):
    """The sun was needed and was not found, or is where the time and the site say it cannot be."""


class LayoutError(ProcessingError, code="LAY-000"):
    """Furniture cannot be arranged as asked."""


class PlanError(LayoutError, code="LAY-001"):
    """A floor plan that cannot be right: self-crossing (the crossing named), open, no area, an opening off its wall."""


class RoomTooSmallError(LayoutError, code="LAY-002"):
    """The room cannot hold the largest item asked for, in any position."""


class NoDoorError(LayoutError, code="LAY-003"):
    """The room has no door, so that no path through it can be checked."""


class ItemError(LayoutError, code="LAY-004", exit_code=2):
    """An unknown item (the nearest names are suggested), or one whose size cannot be right."""


class RulesError(LayoutError, code="LAY-005", exit_code=2):
    """A rules file that cannot be read, or a rule set that is not in it; the key is named."""


class PinError(LayoutError, code="LAY-006", exit_code=2):
    """A pinned item that breaks a hard rule where it stands, or is not among the items."""


class ModelFileError(LayoutError, code="LAY-007"):
    """A furniture file that cannot be read or holds no furniture: damaged, too large, outside its folder."""


class CatalogueError(LayoutError, code="LAY-008", exit_code=2):
    """A folder that is no catalogue, a model that is not in it, or a size that a model cannot be made in."""


class RoomError(ProcessingError, code="ROO-001"):
    """A room that cannot be: floor, heights or openings that do not fit; names every key."""


class SegmenterError(ProcessingError, code="SEG-001"):
    """A segmentation network that cannot be loaded, or does not keep the contract that was declared for it."""


class ModelError(ProcessingError, code="SEG-002"):
    """A model of the list that cannot be fetched or kept, is not installed, or a file that is none of them."""


class RenderingError(ProcessingError, code="REN-000"):
    """A picture cannot be rendered as asked."""


class SceneError(RenderingError, code="REN-001"):
    """A scene that cannot be: broken meshes, no surfaces, an outdoor picture of the wrong shape."""


class MaterialError(RenderingError, code="REN-002"):
    """An albedo, a texture, a transmittance or an emission that light cannot have; names the surface."""


class NoBalanceError(RenderingError, code="REN-003"):
    """Light that is never absorbed: a closed scene of albedo 1 with a source in it."""


class EngineError(RenderingError, code="REN-004", exit_code=2):
    """The renderer asked for cannot be had: no ray tracer works here, or the one named is unknown."""


class AlbedoError(RenderingError, code="REN-005"):
    """Albedo cannot be estimated: no light in the picture, or no visible surface."""


class RelightError(RenderingError, code="REN-006"):
    """Another light cannot be worked out: a basis of another scene or version, or one too large to be held."""


class ViewpointError(RenderingError, code="REN-007"):
    """A place from which the room cannot be looked at: outside of it, or within a piece of furniture (named)."""


class DaylightError(ProcessingError, code="DAY-001"):
    """The light at another time cannot be computed: no site or heading, or the sun is below the horizon."""


class NoRoomError(ProcessingError, code="ROO-002"):
    """A picture that shows no room that could be estimated: black, cropped, not a panorama, or outdoors."""


class LayoutFileError(ProcessingError, code="ROO-003"):
    """A room layout in another program's format that is damaged, or is no room."""


class LayoutNetworkError(ProcessingError, code="ROO-004"):
    """A layout network that cannot be loaded, or whose inputs and outputs are not what its kind has."""


class FillerError(ProcessingError, code="RMV-001"):
    """A filling network that cannot be loaded, or whose inputs and outputs are not what the contract asks."""


class RemovalError(ProcessingError, code="RMV-002"):
    """A room that cannot be emptied: what is to be removed covers all that is seen."""


class ClusterError(ProcessingError, code="BAT-001", exit_code=6):
    """No Dask cluster at the address given, or none that can be made here."""


class SessionKilledError(ProcessingError, code="BAT-002"):
    """The process that worked on a session was ended by a signal, twice."""


class SessionTimeoutError(ProcessingError, code="BAT-003"):
    """A session that was not done in the time allowed."""


class WorkerLostError(ProcessingError, code="BAT-004"):
    """The workers that had a session ended, or failed, while they had it."""


class StoreError(ProcessingError, code="BAT-005"):
    """An object store that does not answer, or holds what should not be there."""
