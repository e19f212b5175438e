"""What looks wrong in recordings, and is said before anything is trained."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.studies.notes import (
    other_axes,
    other_cameras,
    other_units,
    reading_notes,
    silent,
)


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({"oak": "ax", "elm": "ax", "ash": "force"}, ["ash alone has the axes force"]),
        ({"oak": "ax", "elm": "ax", "ash": ""}, []),
        ({"oak": "ax", "elm": "force"}, []),
        ({"oak": "ax gx", "elm": "ax gx ax"}, ["2 of 5 have the axes gx"]),
    ],
)
def test_a_class_of_another_sensor_is_told(axes, told):
    rows = tuple(
        Recording(label, "haptic", Path(name), 0)
        for label, names in axes.items()
        for name in names.split(" ")
    )
    store = SimpleNamespace(
        reading=lambda row: SimpleNamespace(axes=(row.path.name,) if row.path.name else ())
    )
    notes = other_axes(Recordings(rows), store)
    assert [note.partition(",")[0] for note in notes] == told


def recordings(modality, values):
    """One recording of a class for each of its values, with that value."""
    return {
        Recording(label, modality, Path(f"{value}"), number): value
        for label, some in values.items()
        for number, value in enumerate(some)
    }


def check(notes, told):
    assert len(notes) == bool(told)
    assert not told or notes[0].startswith(told)


@pytest.mark.parametrize(
    ("levels", "told"),
    [
        ({"oak": [0.1, 0.3], "elm": [0.02, 0.05]}, ""),
        ({"oak": [0.1, 0.3], "elm": [9000.0, 4000.0]}, "2 of 4 traces, of elm alone, are 13,333"),
        ({"oak": [0.1, 4000.0], "elm": [9000.0, 0.4]}, "2 of 4 traces are 10,000 times as strong"),
        ({"oak": [1.0, 2.0, 3.0], "elm": [0.003]}, "1 of 4 traces, of elm alone, are 333"),
        ({"oak": [0.0, 0.3], "elm": [0.02, 0.0]}, ""),  # a silent one has no unit
    ],
)
def test_classes_in_another_unit_are_told(levels, told):
    level = recordings("haptic", levels)
    check(other_units(Recordings(tuple(level)), SimpleNamespace(level=level.get)), told)


@pytest.mark.parametrize(
    ("levels", "told"),
    [
        ({"oak": [0.1, 1e-9], "elm": [0.02]}, ""),
        (
            {"oak": [0.1, 0.3], "elm": [0.02, 0.0, 0.0]},
            "2 of 5 traces never change, the first of them 0.0 of elm",
        ),
    ],
)
def test_sensors_that_were_not_connected_are_told(levels, told):
    level = recordings("haptic", levels)
    check(silent(Recordings(tuple(level)), SimpleNamespace(level=level.get)), told)


@pytest.mark.parametrize(
    ("sizes", "told"),
    [
        ({"oak": [0.3, 0.3], "elm": [0.3, 0.4]}, ""),
        ({"oak": [0.3, 12.0], "elm": [0.4, 12.0]}, ""),  # both cameras took both
        ({"oak": [12.0, 8.0, 8.0], "elm": [0.4]}, "1 of 4 photos, of elm alone, are 20"),
    ],
)
def test_a_class_of_another_camera_is_told(sizes, told):
    size = recordings("image", sizes)
    check(other_cameras(Recordings(tuple(size)), SimpleNamespace(extent=size.get)), told)


@pytest.mark.parametrize(("count", "last"), [(5, "4: note 4."), (7, "And 2 more such notes.")])
def test_five_notes_on_files_are_listed_and_others_counted(count, last):
    level = recordings("haptic", {"oak": range(count)})
    store = SimpleNamespace(reading=lambda row: SimpleNamespace(notes=(f"note {row.path}",)))
    notes = reading_notes(Recordings(tuple(level)), store)
    assert notes[:5] == [f"{number}: note {number}." for number in range(5)]
    assert notes[-1] == last
