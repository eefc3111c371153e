"""A camera fitted to points along the sides of a table: of the noses, or of what stands in for one that is not seen.

In: a picture, a camera near the truth, and the edges taken as noses. Out: `CameraFit`. Markers show where the nose in
front of them is. Where one side shows none, a dark one against its own shadow, the end of the cloth behind it stands
in: it lies as far behind the nose as at the other sides.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.shot import NOSE_HEIGHT
from sysid.vision.camera.pose import CameraFit, Mask, Rails, fit_camera
from sysid.vision.camera.printed.marker_camera import stand_ins
from sysid.vision.camera.printed.markers import Markers
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edge_blur import blur_shift
from sysid.vision.camera.table.edges import Edge, Image, edge_points
from sysid.vision.camera.table.noses import CushionReading, TableEvidence, with_offsets
from sysid.vision.camera.trust import K1_PRIOR

EDGE_SEARCH_PX = (5.0, 3.0, 2.0)  # about an expected edge, round by round
MIN_SIDE_POINTS = 8  # of a side


@dataclass(frozen=True)
class SideEdges:
    """The edges along the sides, offsets from the noses of the camera that goes with them."""

    noses: Mapping[int, Edge]  # by rail
    ends: Mapping[int, Edge]  # of the cloth, at sides whose nose is not seen
    behind: Mapping[int, Edge]  # ends of the cloth behind noses that are seen
    width: float  # from the noses to the end of the cloth [m]
    markers: Markers  # that agree

    def found(self) -> SideEdges:
        """The same about a camera that was fitted to them."""
        noses, ends, behind = (
            {rail: dataclasses.replace(edge, offset=offset) for rail, edge in some.items()}
            for some, offset in ((self.noses, 0.0), (self.ends, self.width), (self.behind, self.width))
        )
        return dataclasses.replace(self, noses=noses, ends=ends, behind=behind)


@dataclass(frozen=True)
class FittedSides:
    """A camera fitted to points along the sides."""

    lines: CameraFit
    sure: Mask  # (n,) points in front of markers
    ends: Mapping[int, Array]  # points where the cloth ends behind noses that are seen, by rail: (n, 2) [pixels]
    shifts: Mapping[int, float]  # of the noses by blur, by rail, which were taken off them [m]


def side_edges(reading: CushionReading, seen: TableEvidence, rough: Camera, markers: Markers) -> SideEdges:
    """The edges of a reading.

    Args:
        reading: of the cushions.
        seen: what it was read from.
        rough: camera from which that was seen.
        markers: those that agree.
    """
    unseen = [rail for rail in seen.edges if rail not in reading.noses]
    instead = {rail: seen.ends[rail] for rail in unseen if rail in seen.ends}
    if len(markers) or len(unseen) != 1 or len(seen.ends) < len(seen.edges) or reading.at_end:
        instead = {}
    behind = {rail: end for rail, end in seen.ends.items() if rail in reading.noses}
    if len(markers) or reading.at_end:  # markers' edges, or the noses themselves
        behind = {}
    noses, ends, behind = (with_offsets(some, rough, reading.camera) for some in (reading.noses, instead, behind))
    return SideEdges(noses, ends, behind, reading.cushion_width, markers)


def fitted_to_edges(
    light: Image, camera: Camera, edges: SideEdges, unknown: tuple[str, ...], progress: Callable[[str], None]
) -> FittedSides:
    """The camera fitted to points of the edges, searched within ever smaller distances.

    Raises:
        BadInput: fewer than three sides have edges that can be followed.
    """
    prior, focal = dict(K1_PRIOR), float(camera.matrix[0, 0])
    for k, search in enumerate(EDGE_SEARCH_PX):
        progress(f"edge points, round {k + 1} of {len(EDGE_SEARCH_PX)}")
        pixels, rails, sure = _points(light, camera, edges, search)
        free = unknown if len(set(rails.tolist())) == 4 else tuple(n for n in unknown if n != "focal")
        prior["focal"] = (float(np.log(focal / camera.matrix[0, 0])), 0.3)
        lines = fit_camera(camera, pixels, rails, free, prior=prior, sure=sure)
        camera, edges = lines.camera, edges.found()
    shifts = {rail: blur_shift(light, camera, rail, edge) for rail, edge in edges.noses.items()}
    for rail, shift in shifts.items():
        pixels[rails == rail] = _inwards(camera, pixels[rails == rail], rail, shift)
    prior["focal"] = (float(np.log(focal / camera.matrix[0, 0])), 0.3)
    lines = fit_camera(camera, pixels, rails, free, prior=prior, sure=sure)
    search = EDGE_SEARCH_PX[-1]
    ends = {rail: edge_points(light, camera, rail, edge, search) for rail, edge in edges.behind.items()}
    return FittedSides(lines, sure, ends, shifts)


def _points(light: Image, camera: Camera, edges: SideEdges, search: float) -> tuple[Array, Rails, Mask]:
    """Points (n, 2) on the noses, the rail of each (n,), and which are those in front of markers (n,)."""
    pixels = {rail: edge_points(light, camera, rail, edge, search) for rail, edge in edges.noses.items()}
    for rail, edge in edges.ends.items():
        pixels[rail] = _inwards(camera, edge_points(light, camera, rail, edge, search), rail, edges.width)
    pixels = {rail: points for rail, points in pixels.items() if len(points) >= MIN_SIDE_POINTS}
    instead, their = stand_ins(camera, edges.markers)
    for rail in sorted({*their.tolist()} - pixels.keys()):
        pixels[rail] = instead[their == rail]
    if len(pixels) < 3:
        raise BadInput("the edges of the cushions are too faint; film with more light, or more frames")
    rails = np.repeat(np.array(list(pixels)), [len(points) for points in pixels.values()]).astype(np.intp)
    return np.concatenate(list(pixels.values())), rails, ~np.isin(rails, [*edges.noses, *edges.ends])


def _inwards(camera: Camera, pixels: Array, rail: int, width: float) -> Array:
    """Pixels (n, 2) at the height of the noses, moved so far towards the table [m]."""
    height = NOSE_HEIGHT * camera.radius
    xy = camera.on_plane(pixels, height)
    xy[:, rail // 2] -= (1.0 - 2.0 * (rail % 2)) * width
    return camera.project(np.column_stack([xy, np.full(len(xy), height)]))
