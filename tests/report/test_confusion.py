"""Confusions of many classes: nothing lies over anything, and categories are those of the names."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from tex_lightning.report.categories import categories
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure

LONG = "AluminumRhombMeshVersion"


def lmt_names(count: int) -> list[str]:
    """As LMT-108's, in nine categories of unequal size."""
    rng = np.random.default_rng(0)
    return [f"G{kind}{LONG}{i}" for i, kind in enumerate(np.sort(rng.integers(1, 10, count)))]


def blocks(count: int, size: int) -> np.ndarray:
    """Ten samples a class, three of them taken for the next class of its block."""
    counts = 7 * np.eye(count, dtype=np.int64)
    for i in range(count):
        begin = i // size * size
        counts[i, begin + (i + 1 - begin) % min(size, count - begin)] += 3
    return counts


def overlaps(figure) -> list[tuple[str, str]]:
    """Pairs of texts that lie over each other by more than a pixel, and texts that are cut."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    boxes = {text: text.get_window_extent(renderer) for text in texts}
    width, height = canvas.get_width_height()
    found = [
        (text.get_text(), "the edge")
        for text, box in boxes.items()
        if box.x0 < -1 or box.y0 < -1 or box.x1 > width + 1 or box.y1 > height + 1
    ]
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        across, upwards = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > 1 and upwards > 1:
            found.append((one.get_text(), other.get_text()))
    return found


@pytest.mark.parametrize(
    ("count", "named"),
    [
        (12, True), (69, True), (69, False),
        pytest.param(108, True, marks=pytest.mark.slow),
        pytest.param(108, False, marks=pytest.mark.slow),
        pytest.param(1000, True, marks=pytest.mark.slow),
        pytest.param(1000, False, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_no_text_lies_over_another(count, named):
    classes = lmt_names(count) if named else [f"{LONG.lower()} {i}" for i in range(count)]
    counts = blocks(count, 7)
    assert overlaps(confusion_figure(counts, classes, "haptic: votes on 690 samples")) == []
    assert overlaps(class_accuracy_figure(counts, classes, "haptic", "haptic: 690 samples")) == []


def test_categories_beside_the_matrix_hold_the_counts_of_their_classes():
    classes = lmt_names(69)
    counts = np.random.default_rng(1).integers(0, 9, (69, 69))
    left, right, _ = confusion_figure(counts, classes, "t").axes
    kinds = [name[:2] for name in classes]
    assert [label.get_text() for label in right.get_yticklabels()] == sorted({*kinds})
    texts = {tuple(map(round, text.get_position())): int(text.get_text()) for text in right.texts}
    for row, true in enumerate(sorted({*kinds})):
        for column, predicted in enumerate(sorted({*kinds})):
            own = counts[[kind == true for kind in kinds]][:, [kind == predicted for kind in kinds]]
            assert texts[column, row] == own.sum()
    assert len(left.get_yticklabels()) == 69


def test_classes_are_divided_by_the_first_word_that_tells_some_apart():
    counts = np.eye(40, dtype=np.int64)
    words = ["mesh", "wood", "foam", "stone"]
    found = categories(counts, [f"S{i:03}_{words[i % 4]}_soft" for i in range(40)])
    assert found == {word: [*range(words.index(word), 40, 4)] for word in sorted(words)}


def test_without_one_what_is_confused_is_together():
    rng = np.random.default_rng(3)
    counts, order = blocks(64, 8), rng.permutation(64)
    classes = [f"{chr(97 + i % 26)}{chr(97 + i // 3)}" for i in range(64)]  # no word in common
    found = categories(counts[np.ix_(order, order)], classes)
    kept = sorted(sorted({int(order[i]) // 8 for i in members}) for members in found.values())
    assert kept == [[i] for i in range(8)]
    assert all(name.endswith(" + 7") for name in found)


@pytest.mark.parametrize("count", [40, 108])
def test_names_that_differ_in_the_middle_lose_no_class(count):
    names = [f"material_{at:04}_variant" for at in range(count)]
    groups = categories(blocks(count, 4), names)
    assert sorted(index for members in groups.values() for index in members) == list(range(count))


def test_classes_that_are_never_right_are_divided_as_well():
    groups = categories(1 - np.eye(12, dtype=int), [f"x{n}" for n in range(12)])
    assert sorted(index for members in groups.values() for index in members) == list(range(12))


def test_a_matrix_of_very_many_classes_is_no_larger():
    """Of a thousand it would take two gigabytes, and no picture so large is read again."""
    names, counts = [f"m{at % 10} {at}" for at in range(400)], np.eye(400, dtype=np.int64)
    largest = confusion_figure(counts[:150, :150], names[:150], "t")
    figure = confusion_figure(counts, names, "t")
    assert figure.get_size_inches() == pytest.approx(largest.get_size_inches())
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == []


def test_many_classes_show_the_worst_with_what_they_are_taken_for():
    classes, counts = lmt_names(69), blocks(69, 7)
    counts[40] = 0
    counts[40, 50] = 10
    (axes,) = class_accuracy_figure(counts, classes, "haptic", "t").axes
    assert "the 25 worst of 69 classes; the other 44 reach at least 70%" in axes.get_title()
    assert axes.get_yticklabels()[0].get_text().endswith("40 (10)")
    assert axes.texts[0].get_text().startswith("10 taken for G")
    assert len(axes.patches) == 25


def test_classes_without_a_sample_are_not_the_worst():
    classes, counts = lmt_names(69), np.zeros((69, 69), np.int64)
    counts[60:65, 60:65] = 7 * np.eye(5)
    counts[64, 3] = 2
    (axes,) = class_accuracy_figure(counts, classes, "haptic", "t").axes
    assert axes.get_title().endswith("the 5 classes that were tested")
    assert [label.get_text()[-3:] for label in axes.get_yticklabels()] == ["(9)"] + ["(7)"] * 4
    counts[:30, 2] = 3
    (axes,) = class_accuracy_figure(counts, classes, "haptic", "t").axes
    assert "the 25 worst of 35 classes that were tested; the other 10" in axes.get_title()
