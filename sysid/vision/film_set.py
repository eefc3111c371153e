"""Films of one camera in one clip set: what `sysid track` does, film by film, in a folder that grows.

In: films, how they were taken, and a folder. Out: the outcome of each film as it comes, with its clips written into the
folder. Films whose clips are there already are not read again.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2

from models.commands.console import Progress
from models.errors import BadInput
from sysid.clips import ClipSet, write_clip_set
from sysid.vision.film import Taken, TrackedFilm, film_mark, track_same_film, tried_film
from sysid.vision.sheet import write_sheet
from sysid.vision.tracks.recordings import (
    check_camera,
    finished,
    joined,
    names_of,
    of_video,
    place_of,
    video_name,
    videos_in,
)

if TYPE_CHECKING:
    from models.recording.viewer import Feed


@dataclass(frozen=True)
class FilmOutcome:
    """What became of one of several films."""

    name: str  # that clips are named by
    video: str
    film: TrackedFilm | None = None  # None where its clips were there already, or it was refused
    refused: BadInput | None = None


class FilmSet:
    """Films of one camera, and the folder of their clips."""

    def __init__(self, videos: Sequence[str], folder: Path, *, anew: bool = False) -> None:
        """Nothing is read or written yet.

        Args:
            videos: films, folders of pictures, or patterns of their names.
            folder: of the clip set, which clips join that are not there yet.
            anew: whether a clip set that is there is replaced.

        Raises:
            BadInput: two films have one name, or the folder holds something else.
        """
        begun = folder.is_dir() and (folder / "clips.toml").is_file() and finished(folder) is not None
        if folder.exists() and not anew and not begun and (not folder.is_dir() or any(folder.iterdir())):
            raise BadInput(f"{folder}: already exists; choose another folder, or replace a clip set with --force")
        if folder.is_dir() and any(folder.iterdir()) and not (folder / "clips.toml").is_file():
            raise BadInput(f"{folder}: is not a clip set; choose another folder")
        self.named, self.folder, self._anew = names_of(videos), folder, anew
        self.clip_set: ClipSet | None = None  # so far

    def tracked(
        self, taken: Taken, progress: Progress, scheduler: str | None = None, feed: Feed | None = None
    ) -> Generator[FilmOutcome, None, None]:
        """What becomes of every film, in order; its clips are in the folder then.

        Args:
            taken: how the films were taken.
            progress: receives a line on what is being done.
            scheduler: address of a cluster whose workers track.
            feed: a viewer to be fed.

        Raises:
            BadInput: the folder holds clips of another table.
        """
        cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
        self.clip_set = None if self._anew else finished(self.folder)
        if self.clip_set is not None:
            check_camera(self.clip_set, taken.camera, self.folder)
        done = videos_in(self.clip_set)
        films = _films(
            [video for name, video in self.named.items() if name not in done], taken, progress, scheduler, feed
        )
        try:
            for name, video in self.named.items():
                if name in done:
                    yield FilmOutcome(name, video)
                    continue
                film = next(films)
                if isinstance(film, BadInput):
                    yield FilmOutcome(name, video, refused=film)
                    continue
                if film.clips is not None:
                    place = place_of(video, self.folder)
                    more = of_video(film.clips, name, film.result, place, film.fps)
                    self.clip_set = joined(self.clip_set, more)
                    write_clip_set(self.clip_set, self.folder)
                yield FilmOutcome(name, video, film)
        except KeyboardInterrupt as end:
            if self.clip_set is not None:
                kept = len(videos_in(self.clip_set))
                end.add_note(f"{kept} videos are kept in {self.folder}: the same command continues")
            raise
        finally:
            films.close()

    def write_sheet(self, path: Path, taken: Taken) -> None:
        """Write the contact sheet of all clips."""
        if self.clip_set is not None:
            write_sheet(path, self.clip_set, taken.camera, self.named, taken.fps)


def _films(
    videos: Sequence[str], taken: Taken, progress: Progress, scheduler: str | None, feed: Feed | None
) -> Generator[TrackedFilm | BadInput, None, None]:
    """What becomes of films, in order; tracked by a cluster where it has an address."""
    from models.workers import open_workers

    if scheduler is None:
        for video in videos:
            yield tried_film(video, taken, progress, feed)
        return
    tasks = [(os.path.abspath(video), video_name(video), taken, film_mark(video)) for video in videos]
    with open_workers(scheduler, 0, progress=progress) as workers:
        yield from workers.in_turn(track_same_film, tasks)
