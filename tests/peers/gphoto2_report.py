"""What libgphoto2's own initiator says of its virtual camera, as JSON (``gphoto2_report.py``, VCAMERADIR set).

A process of its own, for the same reasons as `tests.peers.vcamera_child`. It imports nothing of ours.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from typing import Any

import gphoto2


def names(found: Any) -> list[str]:
    """Return the names of a list of libgphoto2."""
    return [found.get_name(i) for i in range(found.count())]


def files(camera: Any, folder: str) -> Iterator[dict[str, Any]]:
    """Yield all files below a folder."""
    for name in names(camera.folder_list_files(folder)):
        # Each owner has a name of its own: what it gives is a view that dies with it.
        infos, file = camera.file_get_info(folder, name), camera.file_get(folder, name, gphoto2.GP_FILE_TYPE_NORMAL)
        info, data = infos.file, bytes(file.get_data_and_size())
        yield {
            "folder": folder.rsplit("/", 1)[-1],
            "name": name,
            "size_bytes": info.size,
            "mtime": info.mtime,
            "size_px": [info.width, info.height],
            "sha256": hashlib.sha256(data).hexdigest(),
        }
    for name in names(camera.folder_list_folders(folder)):
        yield from files(camera, f"{folder.rstrip('/')}/{name}")


def report() -> dict[str, Any]:
    """Return summary, configuration, store and files of the camera."""
    camera = gphoto2.Camera()
    camera.init()
    keys = ("manufacturer", "cameramodel", "deviceversion", "serialnumber", "vendorextension")
    (store,) = camera.get_storageinfo()
    result = {
        "config": {key: camera.get_single_config(key).get_value() for key in keys},
        "summary": str(camera.get_summary()),
        "store": {
            "capacity_kib": store.capacitykbytes,
            "free_kib": store.freekbytes,
            "free_images": store.freeimages,
            "description": store.description,
            "label": store.label,
        },
        "files": list(files(camera, "/")),
    }
    camera.exit()
    return result


if __name__ == "__main__":
    json.dump(report(), sys.stdout)
