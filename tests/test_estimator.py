"""The estimator: scikit-learn's own checks and tools, forms of input, and the command line."""

import logging
import pickle
import tempfile
import warnings
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from conftest import CLASSES, RATE, SHORT_WINDOWS, make_photo, make_trace
from PIL import Image
from sklearn.base import clone, is_classifier
from sklearn.calibration import CalibratedClassifierCV
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import estimator_checks_generator

import tex_lightning as tl
from tex_lightning.data.readers.arrays import samples_of, write_samples
from tex_lightning_runtime.pixels import as_pixels

SLOW_RATE = 1000
TIME = np.arange(2 * SLOW_RATE) / SLOW_RATE
FREQUENCIES = {"a": 40, "b": 110, "c": 300}
ANY_LENGTH = "recordings may have any length: no number of samples is another than before"
CANNOT_APPLY = {
    "check_n_features_in_after_fitting": ANY_LENGTH,
    "check_classifiers_train": ANY_LENGTH,
    "check_transformer_general": ANY_LENGTH,
}
QUICK = ("check_dict_unchanged", "check_supervised_y_2d", "check_estimators_overwrite_params")


class OfTones(tl.Estimator):
    """Take each number of a table as the strength of a tone, since a few samples are no stroke."""

    def _samples(self, X, modalities):
        return [
            {"haptic": self.tones(np.asarray(sample["haptic"], float))}
            for sample in super()._samples(X, modalities)
        ]

    @staticmethod
    def tones(strengths):
        tones = np.sin(2 * np.pi * 40 * 1.15 ** np.arange(len(strengths))[:, None] * TIME)
        return strengths @ tones + 1e-3 * np.sin(2 * np.pi * 400 * TIME)


def checks(*, fits: bool) -> list:
    """Those of scikit-learn that can apply; of those that fit something a few, or all."""
    found = []
    model = "few/haptic" if fits else "mfcc_nb"  # which takes a quarter of the time
    for estimator, check in estimator_checks_generator(OfTones(model, rate=SLOW_RATE)):
        name = check.func.__name__
        marks = [pytest.mark.xfail(reason=CANNOT_APPLY[name])] if name in CANNOT_APPLY else []
        quick = name in QUICK or name.startswith(("check_no_", "check_do_", "check_get_"))
        quick |= "message" in name or "unfitted" in name or "param" in name
        if quick != fits:
            found.append(pytest.param(estimator, check, id=name, marks=marks))
    return found


@pytest.mark.parametrize(("estimator", "check"), checks(fits=False))
def test_scikit_learns_check(estimator, check):
    with warnings.catch_warnings(action="ignore"):
        check(estimator)


@pytest.mark.slow
@pytest.mark.parametrize(("estimator", "check"), checks(fits=True))
def test_scikit_learns_check_that_fits(estimator, check):
    with warnings.catch_warnings(action="ignore"):
        check(estimator)


def stroke(label: str, seed: int, axes: int = 1) -> np.ndarray:
    rng = np.random.default_rng([seed, ord(label)])
    tone = np.sin(2 * np.pi * FREQUENCIES[label] * TIME + rng.uniform(0, 6))
    return tone + 0.1 * rng.standard_normal((axes, len(TIME)))


@pytest.fixture(scope="module")
def strokes():
    labels = np.repeat(["a", "b", "c"], 4)
    return np.concatenate([stroke(x, n) for n, x in enumerate(labels)]), labels


@pytest.fixture(scope="module")
def fitted(strokes):
    return tl.Estimator("few/haptic", rate=SLOW_RATE).fit(*strokes)


@pytest.fixture(scope="module")
def quick(strokes):
    """What is fitted in a quarter of the time, where any model does."""
    return tl.Estimator("mfcc_nb", rate=SLOW_RATE).fit(*strokes)


def test_three_lines_are_a_model(strokes, fitted):
    x, y = strokes
    assert is_classifier(fitted)
    assert (fitted.predict(x) == y).all()
    assert fitted.score(x, y) == 1
    shares = fitted.predict_proba(x)
    assert shares.shape == (12, 3)
    np.testing.assert_allclose(shares.sum(axis=1), 1)
    assert (fitted.classes_[shares.argmax(axis=1)] == y).all()
    assert len(fitted.transform(x)) == 12


def test_a_class_in_counts_beside_others_in_volts_is_told(quick, strokes):
    x, y = strokes
    mixed = [
        (9000 * row).astype(np.int16) if label == "b" else row
        for row, label in zip(x, y, strict=True)
    ]
    with pytest.warns(UserWarning, match="4 of 12 traces, of b alone, are"):
        model = clone(quick).fit(mixed, y)
    assert len(model.notes_) == 1


def test_a_note_names_recordings_without_the_folder_that_is_gone(quick, strokes):
    x, y = strokes
    timed = np.stack(np.broadcast_arrays(x, TIME), axis=1)
    with pytest.warns(UserWarning, match=r"^haptic_0\.npy and 11 more: an axis rises evenly"):
        clone(quick).fit(timed, y)


def forms(x: np.ndarray) -> dict[str, object]:
    """The same recordings as people have them."""
    return {
        "aeon's cases": x[:, None],
        "list of samples": [*x],
        "list of axes": [*x[:, None]],
        "lists of numbers": x.tolist(),
        "tensors": [torch.from_numpy(row) for row in x],
        "by name": {"haptic": [*x]},
        "a sample each": [{"haptic": row} for row in x],
        "pandas": pd.DataFrame({"haptic": [*x]}),
        "a column of pandas": pd.Series([*x], index=range(5, 5 + len(x))),
        "an array of objects": np.array([*x, None], dtype=object)[:-1],
        "a table of numbers": pd.DataFrame(x),
    }


@pytest.mark.parametrize("form", forms(np.zeros((2, 2))))
def test_every_form_of_the_same_recordings_is_read_alike(strokes, fitted, form):
    x, _ = strokes
    with warnings.catch_warnings(action="ignore"):  # of scikit-learn, on names of columns
        given = forms(x)[form]
        assert (fitted.predict_proba(given) == fitted.predict_proba(x)).all()


@pytest.mark.parametrize("form", ["aeon's cases", "a sample each", "a table of numbers"])
def test_every_form_trains_alike(strokes, quick, form):
    x, y = strokes
    with warnings.catch_warnings(action="ignore"):
        found = clone(quick).fit(forms(x)[form], y)
    assert (found.predict_proba(x) == quick.predict_proba(x)).all()


def assert_same_weights(one: tl.Estimator, other: tl.Estimator) -> None:
    assert_equal_states(one.predictor_.classifier, other.predictor_.classifier)


def assert_equal_states(one, other) -> None:
    one, other = one.state_dict(), other.state_dict()
    assert one.keys() == other.keys()
    for name, value in one.items():
        assert isinstance(value, dict) or torch.equal(value, other[name]), name


def test_lengths_and_numbers_of_axes_may_differ_from_the_training(fitted, strokes):
    x, y = strokes
    longer = [np.tile(row, 1 + n % 3)[: 2400 + 31 * n] for n, row in enumerate(x)]
    assert (fitted.predict(longer) == y).all()
    three = [stroke(label, n, axes=3) for n, label in enumerate(y)]
    assert (tl.Estimator(rate=SLOW_RATE).fit(three, y).predict(three) == y).all()


@pytest.mark.parametrize(
    "labels", [[0] * 4 + [2] * 4 + [10] * 4, [True] * 4 + [False] * 8, ["1 "] * 4 + ["ü"] * 8]
)
def test_labels_keep_their_type_and_order(strokes, labels):
    model = tl.Estimator("mfcc_nb", rate=SLOW_RATE).fit(strokes[0], labels)
    assert model.classes_.tolist() == sorted(set(labels))
    assert model.classes_.dtype == np.asarray(labels).dtype
    found = model.predict(strokes[0])
    assert found.dtype == model.classes_.dtype
    best = model.classes_[model.predict_proba(strokes[0]).argmax(axis=1)]
    assert (found == best).all()


@pytest.mark.slow
def test_scikit_learns_tools_take_it(strokes):
    x, y = strokes
    groups = np.tile([1, 1, 2, 2], 3)
    model = tl.Estimator(rate=SLOW_RATE)
    folds = StratifiedGroupKFold(2)
    assert cross_val_score(model, [*x], y, groups=groups, cv=folds).tolist() == [1, 1]
    search = GridSearchCV(model, {"haptic.features.thresholds": [3, 5]}, cv=folds)
    best = search.fit(x, y, groups=groups).best_estimator_
    thresholds = search.best_params_["haptic.features.thresholds"]
    assert best.predictor_.card.senses["haptic"]["features"]["thresholds"] == thresholds
    embedded = make_pipeline(model.set_output(transform="pandas"), LogisticRegression())
    assert embedded.fit(x, y).score(x, y) == 1
    assert embedded[:-1].transform(x).columns[0] == "haptic0"
    calibrated = CalibratedClassifierCV(clone(model), cv=2, ensemble=False).fit(x, y)
    assert calibrated.predict_proba(x).shape == (12, 3)


def test_copies_are_not_fitted_and_pickles_are(fitted, strokes):
    for way, given in (("predict", strokes[:1]), ("score", strokes)):
        with pytest.raises(NotFittedError):
            getattr(clone(fitted), way)(*given)
    again = pickle.loads(pickle.dumps(fitted))
    assert (again.predict_proba(strokes[0]) == fitted.predict_proba(strokes[0])).all()


def test_parameters_are_the_keys_of_hydra(strokes):
    model = tl.Estimator("haptic", seed=3, **{"haptic.width": 0.1, "debug": "tiny"})
    assert model.get_params()["haptic.width"] == 0.1
    copy = clone(model).set_params(**{"model.haptic.dropout": 0.25, "data.num_workers": 0})
    assert copy.get_params() == model.get_params() | {
        "model.haptic.dropout": 0.25, "data.num_workers": 0,
    }  # fmt: skip
    node = copy.set_params(rate=SLOW_RATE).fit(*strokes).predictor_.card.senses["haptic"]
    assert (node["width"], node["dropout"]) == (0.1, 0.25)
    with pytest.raises(ValueError, match=r"did you mean model\.haptic\.width"):
        clone(copy).set_params(**{"haptic.widht": 1}).fit(*strokes)
    with pytest.raises(ValueError, match=r"crossval\.only is read by task=crossval"):
        clone(copy).set_params(**{"crossval.only": [0]}).fit(*strokes)
    with pytest.raises(ValueError, match="Estimator takes no task"):
        clone(copy).set_params(task="crossval").fit(*strokes)
    with pytest.raises(tl.UserError, match="There is no model few/haptics"):
        tl.Estimator("few/haptics").fit(*strokes)


def test_recordings_have_rates_of_their_own(fitted, strokes):
    x, y = strokes
    pairs = [(SLOW_RATE, row) if n % 2 else (row, SLOW_RATE) for n, row in enumerate(x)]
    model = tl.Estimator().fit(pairs, y)
    assert_same_weights(model, fitted)
    assert (model.predict_proba(pairs) == fitted.predict_proba(x)).all()
    faster = [(2 * SLOW_RATE, np.repeat(row, 2)) for row in x]
    assert (fitted.predict(faster) == y).all()
    assert (model.transform(pairs) == fitted.transform(x)).all()


def test_what_is_wrong_is_one_sentence_and_a_value_error(fitted, strokes):
    x, y = strokes
    with pytest.raises(ValueError, match=r"haptic_0\.npy: The signal has 0\.01 s of movement"):
        clone(fitted).fit(x[:, :10], y)
    with pytest.raises(ValueError, match="takes haptic, not image"):
        fitted.predict({"image": [*x]})
    with pytest.raises(ValueError, match="NaN"):
        fitted.predict([np.full(3000, np.nan)])
    with pytest.raises(ValueError, match=r"nowhere\.wav"):
        fitted.predict(["nowhere.wav"])
    with pytest.raises(ValueError, match="give photos as uint8"):
        clone(fitted).fit(np.zeros((12, 32, 32, 3)), y)
    with pytest.raises(ValueError, match="give a list, of one path"):
        fitted.predict("A.wav")
    with pytest.raises(ValueError, match=r"^X is A\.wav; give a list, of one path"):
        fitted.predict(Path("A.wav"))
    with pytest.raises(ValueError, match=r"^haptic is A\.wav; give a list, of one path"):
        fitted.predict({"haptic": "A.wav"})
    with pytest.raises(ValueError, match=r"^X cannot be read as an array"):
        fitted.predict(torch.from_numpy(x).to("meta"))
    for pair in ((SLOW_RATE, x[0]), (x[0], SLOW_RATE), (x[0], Fraction(SLOW_RATE))):
        for form in (pair, {"haptic": pair}):
            with pytest.raises(ValueError, match="give a list, of one such pair"):
                fitted.predict(form)
    with pytest.raises(ValueError, match="takes haptic, not file"):
        fitted.predict(pd.DataFrame({"file": ["A.wav"]}))
    with pytest.raises(ValueError, match=r"There is no label"):
        clone(fitted).fit(x[:0], y[:0])
    for missing in (None, np.nan, pd.NA):
        with pytest.raises(ValueError, match=r"groups holds .* for sample 1"):
            clone(fitted).fit(x, y, groups=[0, missing, *range(10)])
        for way in (clone(fitted).fit, fitted.score):
            with pytest.raises(ValueError, match=r"y holds .* for sample 1"):
                way(x, ["a", missing, *"abababababa"[:10]])
        for form in ([x[0], missing, *x[2:]], pd.Series([x[0], missing, *x[2:]])):
            with pytest.raises(ValueError, match="Recording 1 of X: it is missing"):
                clone(fitted).fit(form, y)
        with pytest.raises(ValueError, match="Recording 1 of X: There is nothing to classify"):
            fitted.predict([x[0], missing])
    for way in (fitted.fit, fitted.predict_proba):
        with pytest.raises(ValueError, match="Recording 2 of X: haptic holds NaN"):
            way([*x[:2], np.full(3000, np.nan), *x[3:]], *[y][: way == fitted.fit])
    for way in (fitted.predict, fitted.predict_proba, fitted.transform, fitted.explain):
        with pytest.raises(ValueError, match="X holds no recordings"):
            way([])
    with pytest.raises(ValueError, match="takes haptic and image; give them by name"):
        tl.Estimator("fusion", debug="tiny").fit(x, y)


def test_recordings_that_are_all_alike_teach_nothing(fitted, strokes):
    x, y = strokes
    for alike in (np.zeros_like(x), np.tile(x[:1], (12, 1))):
        with pytest.raises(tl.UserError, match="All training recordings are alike"):
            clone(fitted).fit(alike, y)


def test_masked_samples_are_missing_and_any_tensor_is_read(fitted, strokes):
    x, _ = strokes
    masked = np.ma.masked_array(x, mask=x > 1)
    for form in (masked, [*masked]):
        with pytest.raises(ValueError, match="NaN"):
            fitted.predict(form)
    tensor = torch.from_numpy(x).requires_grad_()
    for form in (tensor, [*tensor], tensor.bfloat16()):
        assert (fitted.predict(form) == fitted.predict(x)).all()


def test_what_pandas_leaves_empty_is_absent(tmp_path):
    trace, photo = np.ones(9), np.zeros((4, 4, 3), np.uint8)
    table = pd.DataFrame([{"haptic": trace, "image": photo}, {"image": photo}, {"haptic": pd.NA}])
    for form in (table, table.to_dict("records"), {name: table[name] for name in table}):
        found = samples_of(form, ["haptic", "image"])
        there = [[name for name in row if row[name] is not None] for row in found]
        assert there == [["haptic", "image"], ["image"], []]
        with pytest.raises(tl.UserError, match="Recording 2 of X: it is missing"):
            write_samples(found, ["a", "b", "a"], None, tmp_path)


@pytest.mark.parametrize("mode", ["RGBA", "L", "P", "I;16"])
def test_images_of_pillow_train_in_any_mode(mode, tmp_path):
    image = Image.fromarray(make_photo(0, 0)).convert("L" if mode == "I;16" else mode).convert(mode)
    write_samples([{"close_up": image}], ["a"], None, tmp_path)
    with Image.open(tmp_path / "close_up_0.png") as written:
        np.testing.assert_array_equal(np.asarray(written), as_pixels(image))


def test_the_largest_samples_that_are_read_train(fitted, strokes):
    x, y = strokes
    assert clone(fitted).fit(5e8 * x, y).score(5e8 * x, y) == 1


def test_what_a_fit_keeps_is_of_the_last_that_succeeded(quick, strokes):
    x, y = strokes
    model = clone(quick).fit(pd.DataFrame(x).add_prefix("t"), y)
    with pytest.raises(tl.UserError):
        model.fit(x[:, :10], y)
    assert len(model.feature_names_in_) == model.n_features_in_ == x.shape[1]
    model.fit([*x[:8]], y[:8])
    assert not {"feature_names_in_", "n_features_in_"} & {*vars(model)}


def test_unknown_stands_beside_labels_of_any_type_and_is_wrong(strokes):
    x, y = strokes
    numbers = np.array([{"a": 1, "b": 2, "c": 7}[label] for label in y])
    model = tl.Estimator(rate=SLOW_RATE, **{"decision.unknown": 0.05}).fit(x, numbers)
    noise = 1e3 * np.random.default_rng(0).standard_normal((1, x.shape[1]))
    found = model.predict(np.concatenate([x, noise])).tolist()
    assert found[-1] == "unknown"
    correct = sum(one == other for one, other in zip(found, numbers, strict=False))
    assert correct > 6
    assert model.score([*x, noise[0]], [*numbers.astype(float), 1]) == correct / 13


def test_labels_of_new_classes_have_the_type_of_the_others(fitted, strokes):
    x, y = strokes
    model = clone(fitted).fit(x[:8], (y[:8] == "a").astype(float))
    with pytest.raises(ValueError, match="The classes are float64, and y is int64"):
        model.enroll(x[8:], [4] * 4)
    assert model.enroll(x[8:], [4.0] * 4).predict(x).tolist() == [1] * 4 + [0] * 4 + [4] * 4


def test_classes_of_a_checkpoint_are_sorted_as_metrics_take_them(strokes, tmp_path):
    x, y = strokes
    names = [{"a": "S2", "b": "S10", "c": "S1"}[label] for label in y]
    model = tl.Estimator("mfcc_nb", rate=SLOW_RATE).fit(x, names)
    again = tl.Estimator.load(model.save(tmp_path / "m.ckpt"), rate=SLOW_RATE)
    assert again.predictor_.classes == ["S1", "S2", "S10"]
    assert again.classes_.tolist() == ["S1", "S10", "S2"]
    assert log_loss(names, again.predict_proba(x)) == log_loss(names, model.predict_proba(x)) < 1


@pytest.fixture(scope="module")
def files(surfaces):
    """Paths of the surfaces in the order of the folder, and their labels."""
    table = tl.read_folder(surfaces)
    return {name: [str(row.path) for row in table.of(name)] for name in ("haptic", "image")}, [
        row.label for row in table.of("haptic")
    ]


@pytest.mark.parametrize(
    ("model", "senses", "more"),
    [
        ("few/haptic", ["haptic"], SHORT_WINDOWS),
        ("haptic", ["haptic"], {"debug": "tiny"}),
        pytest.param("mfcc_nb", ["haptic"], {"debug": "tiny"}, marks=pytest.mark.slow),
        pytest.param(
            "fusion",
            ["haptic", "image"],
            {"debug": "tiny", "data.half_scale": False},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_weights_and_labels_are_those_of_the_command_line(
    model, senses, more, files, surfaces, run_once
):
    paths, labels = files
    chosen = f"experiment={model}" if "/" in model else f"model={model}"
    keys = [f"{name}={str(value).lower()}" for name, value in more.items()]
    run = run_once(chosen, "data=folder", f"data.root={surfaces}", "data.test_fold=null", *keys)
    given = {name: paths[name] for name in senses}
    estimator = tl.Estimator(model, **more).fit(given, labels)
    shell, python = tl.load(run), estimator.predictor_
    assert_equal_states(shell.classifier, python.classifier)
    kinds = {"haptic": make_trace, "image": make_photo}
    new = [{name: kinds[name](kind, 20) for name in senses} for kind in range(3)]
    said = [shell.predict(rate=RATE, **sample) for sample in new]
    assert estimator.predict(new).tolist() == [found.label for found in said]
    table = [[*found.probabilities.values()] for found in said]
    np.testing.assert_array_equal(estimator.predict_proba(new), table)


def test_arrays_are_the_files_that_hold_them(files):
    import soundfile

    paths, labels = files[0]["haptic"][::3], files[1][::3]
    arrays = [soundfile.read(path)[0] for path in paths]
    of_files = tl.Estimator(**SHORT_WINDOWS).fit(paths, labels)
    of_arrays = tl.Estimator(rate=RATE, **SHORT_WINDOWS).fit(arrays, labels)
    assert_same_weights(of_arrays, of_files)


def test_checkpoints_go_both_ways(fitted, strokes, tmp_path, bands, files):
    x, _ = strokes
    fitted.save(tmp_path / "new" / "m.ckpt")
    loaded = tl.load(tmp_path / "new" / "m.ckpt")
    assert loaded.predict(haptic=x[0], rate=SLOW_RATE).label == "a"
    again = tl.Estimator.load(tmp_path / "new" / "m.ckpt", rate=SLOW_RATE)
    assert (again.predict_proba(x) == fitted.predict_proba(x)).all()
    scored = tl.Estimator.load(tmp_path / "new" / "m.ckpt", **{"decision.rule": "vote"})
    assert (again.predictor_.card.rule, scored.predictor_.card.rule) == ("score", "vote")
    paths, labels = files
    assert tl.Estimator.load(bands).score(paths["haptic"], labels) == 1


def test_it_enrols_explains_and_exports(fitted, strokes, tmp_path):
    x, y = strokes
    model = clone(fitted).fit(x[:8], y[:8]).enroll(x[8:], y[8:])
    assert model.classes_.tolist() == ["a", "b", "c"]
    assert (model.predict(x) == y).all()
    (shares,) = (said["haptic"] for said in fitted.explain(x[:1]))
    assert shares.shape[0] == 1
    assert shares.shape[2] == 3
    np.testing.assert_allclose(shares.sum(axis=2), 1, rtol=1e-5)
    assert (shares.argmax(axis=2) == 0).all()
    files = fitted.export(tmp_path / "web", "card")
    assert (tmp_path / "web" / "MODEL_CARD.md") in files
    with pytest.raises(ValueError, match="already has a"):
        fitted.enroll(x[:4], y[:4])


def test_it_is_quiet_and_leaves_no_folder(strokes, tmp_path, monkeypatch, capfd, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    threads, state = torch.get_num_threads(), torch.random.get_rng_state()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with caplog.at_level(logging.NOTSET):
        tl.Estimator("haptic", rate=SLOW_RATE, debug="tiny").fit(*strokes).predict(strokes[0])
    assert capfd.readouterr() == ("", "")
    assert not [*tmp_path.iterdir()]
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.random.get_rng_state(), state)


def test_a_program_in_float64_trains_alike(strokes, fitted):
    torch.set_default_dtype(torch.float64)
    try:
        model = tl.Estimator("few/haptic", rate=SLOW_RATE).fit(*strokes)
        assert (model.predict_proba(strokes[0]) == fitted.predict_proba(strokes[0])).all()
    finally:
        torch.set_default_dtype(torch.float32)


def test_it_tells_and_keeps_what_is_asked_for(strokes, tmp_path, capfd):
    model = tl.Estimator(
        "haptic", rate=SLOW_RATE, debug="tiny", verbose=1, directory=tmp_path / "runs"
    ).fit(*strokes)
    assert "Traces keep their own rate" in capfd.readouterr().err
    assert model.run_folder_.parent == tmp_path / "runs"
    assert (model.run_folder_ / "checkpoints" / "haptic.ckpt").is_file()
    assert [*model.run_folder_.rglob("events.out.tfevents.*")]
    assert tl.load(model.run_folder_).classes == ["a", "b", "c"]


def test_a_class_of_ones_own_is_a_model(strokes, tmp_path):
    (tmp_path / "conf" / "experiment").mkdir(parents=True)
    lines = ["# @package _global_", "defaults: [/experiment/few/haptic]"]
    lines += ["model: {haptic: {features: {thresholds: 3}}}"]
    (tmp_path / "conf" / "experiment" / "mine.yaml").write_text("\n".join(lines))
    model = tl.Estimator("mine", rate=SLOW_RATE, config_dir=tmp_path / "conf").fit(*strokes)
    assert model.predictor_.card.senses["haptic"]["features"]["thresholds"] == 3
    assert (model.predict(strokes[0]) == strokes[1]).all()
    assert len(CLASSES) == 3


def test_an_empty_label_or_group_is_told_of_y_and_groups_not_of_a_file(strokes):
    x, y = strokes
    with pytest.raises(ValueError, match=r"^y holds an empty label; give every sample one\.$"):
        tl.Estimator(rate=SLOW_RATE).fit(x, [" ", *y[1:]])
    with pytest.raises(ValueError, match=r"^groups holds an empty text; give every sample one; "):
        tl.Estimator(rate=SLOW_RATE).fit(x, y, groups=[*y[1:], " "])


@pytest.mark.parametrize("one", [1, True])
def test_a_label_as_text_and_otherwise_is_no_single_class(strokes, one):
    x, _ = strokes
    with pytest.raises(ValueError, match=f"y holds {one} as text and otherwise; give"):
        tl.Estimator(rate=SLOW_RATE).fit(x, [one] * 4 + [str(one)] * 4 + ["b"] * 4)


@pytest.mark.parametrize("name", ["verbose_", "_seed", "classes_", "predict", ""])
def test_a_name_that_is_no_key_is_not_passed_over(name):
    for give in (lambda keys: tl.Estimator(**keys), lambda keys: tl.Estimator().set_params(**keys)):
        with pytest.raises(tl.UserError, match=f"^'{name}' is no parameter; give a key of Hydra"):
            give({name: 1})


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("verbose", "yes", "verbose is 'yes': give true or false or a whole number"),
        ("rate", [1000], r"rate is \[1000\]: give a number or null"),
        ("directory", 3, "directory is 3: give text or null"),
        ("seed", np.random.RandomState(0), "seed is RandomState.*; give text, numbers, or lists"),
        ("model", None, "There is no model None"),
    ],
)
def test_a_parameter_of_another_type_is_one_sentence(strokes, key, value, said):
    with pytest.raises(tl.UserError, match=f"^{said}"):
        tl.Estimator(**{"rate": SLOW_RATE, key: value}).fit(*strokes)


def test_another_class_is_named_by_its_key(strokes):
    model = tl.Estimator("haptic", rate=SLOW_RATE, **{"haptic.network._target_": "nowhere.Net"})
    with pytest.raises(tl.UserError, match="nowhere"):
        clone(model).fit(*strokes)
