"""Add classes to a trained network without its old recordings.

What a network computes up to FC2 stays as it is; its score layer gets rows. The old
classes are represented by features drawn from their statistics. The new rows are fitted by logistic
regression while the old ones stay as they are: nothing changes among the old classes. Nearest
means, linear discriminants and weights imprinted from the mean feature do worse
(docs/add_class.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import ROWS, STATISTICS, SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import ScoreLayer, score_layer_of
from tex_lightning.networks.line import GAINLESS, SHORT, ScoreReach
from tex_lightning.networks.range import FeatureRange, RangeGate

Fragments = Sequence[Sequence[Tensor]]  # by class and recording, features (D, positions)
DRAWN = 60  # features of each class that stand for its recordings
FRAGMENTS = 200  # of a recording that are looked at, at most
STRENGTH = 1e-6  # of the penalty on a row's squared length, times the spread of the means
STEPS = 200


def fit_new_class_weights(
    statistics: FeatureStatistics,
    weight: Tensor,
    bias: Tensor,
    features: Fragments,
    *,
    temperature: float,
    new_bias: float | None,
) -> tuple[Tensor, Tensor]:
    """Fit weights (added, D) and biases (added,) of the new classes.

    Args:
        statistics: Statistics of all classes, the new ones last.
        weight: (classes, D), rows of the old classes.
        bias: (classes,), biases of the old classes.
        features: Features of the new classes.
        temperature: Divisor of the scores before the softmax.
        new_bias: Bias of the new rows; None fits it.
    """
    known, added = len(weight), len(features)
    inputs, labels, shares = _examples(statistics, features)
    scores = inputs @ weight.T + bias
    centre = statistics.means.mean(dim=0)
    origin = centre if new_bias is None else torch.zeros_like(centre)
    inputs = statistics.whiten(inputs - origin)  # else hardly any step along narrow directions
    penalty = STRENGTH * statistics.whiten(statistics.means - centre).square().sum(dim=1).mean()
    rows = torch.zeros(added, len(centre), requires_grad=True)
    biases = torch.full((added,), new_bias or 0.0, requires_grad=new_bias is None)
    fitted = [rows, biases] if new_bias is None else [rows]
    optimizer = torch.optim.LBFGS(fitted, max_iter=STEPS, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        optimizer.zero_grad()
        logits = torch.cat([scores, inputs @ rows.T + biases], dim=1) / temperature
        errors = nn.functional.cross_entropy(logits, labels, reduction="none")
        total = (shares * errors).sum() / (known + added) + penalty * rows.square().sum()
        total.backward()  # type: ignore[no-untyped-call]  # no annotation in PyTorch
        return total

    optimizer.step(loss)  # type: ignore[no-untyped-call]  # likewise
    weights = statistics.weights_before(rows.detach())
    return weights, biases.detach() - weights @ origin


def _examples(statistics: FeatureStatistics, features: Fragments) -> tuple[Tensor, Tensor, Tensor]:
    """Return features (N, D), their classes and what each counts for; all classes count alike.

    Of every class features are drawn as those of recordings are distributed, and moved as the
    fragments of the new recordings lie about the mean of theirs: fragments are what will vote. The
    new fragments themselves count as much again.
    """
    generator = torch.Generator().manual_seed(0)
    recordings = [recording for members in features for recording in members]
    apart = torch.cat([_some(x - x.mean(dim=1, keepdim=True)) for x in recordings])
    drawn = statistics.draw(DRAWN, generator)
    drawn = drawn + apart[torch.randint(len(apart), drawn.shape[:2], generator=generator)]
    groups = list(enumerate(drawn))
    for number, members in enumerate(features, start=len(drawn) - len(features)):
        groups.append((number, torch.cat(list(map(_some, members)))))
    times = torch.tensor([number for number, _ in groups]).bincount().tolist()
    labels = torch.cat([torch.full((len(rows),), number) for number, rows in groups])
    shares = [torch.full((len(rows),), 1 / (len(rows) * times[number])) for number, rows in groups]
    return torch.cat([rows for _, rows in groups]), labels, torch.cat(shares)


def _some(features: Tensor) -> Tensor:
    """Return fragments (n, D) of a recording's features (D, positions), evenly spread."""
    step = -(-features.shape[1] // FRAGMENTS)
    return features[:, ::step].T


def add_classes(
    classifier: SurfaceClassifier, names: Sequence[str], features: Mapping[str, Fragments]
) -> SurfaceClassifier:
    """Copy a classifier and add classes after its own.

    Each sense of a fusion has its columns, fitted apart. The sum then knows what all senses say,
    and a part of the senses is right by itself. The only bias is in the partial logits of the last
    sense; the new classes have the mean of the old ones', which leaves nothing to it that the
    other senses would lack.

    Args:
        classifier: Trained, on the CPU, with :attr:`~SurfaceClassifier.statistics`.
        names: Names of the new classes.
        features: By sense what :meth:`~SurfaceClassifier.embedding` gives for the recordings of
            each new class, at least one of each.

    Raises:
        UserError: If it has no statistics, or its class scores are no layer of their own.
    """
    layer = _check_extensible(classifier)
    fusion, senses = classifier.fusion, classifier.card.sense_names
    means = {name: [_means(members) for members in features[name]] for name in senses}
    statistics = {
        name: _with_classes(cast(FeatureStatistics, classifier.statistics[name]), means[name])
        for name in senses
    }
    weight, bias = layer.weight.detach().flatten(1), cast(Tensor, layer.bias).detach()
    sizes, rows = [weight.shape[1]] if fusion is None else fusion.sizes, []
    for name, block in zip(senses, torch.split(weight, sizes, dim=1), strict=True):
        last = name == senses[-1]
        new_bias = float(bias.mean()) if last else 0.0
        new, biases = fit_new_class_weights(
            statistics[name], block, bias if last else torch.zeros_like(bias), features[name],
            temperature=classifier.card.temperature,
            new_bias=None if fusion is None else new_bias,
        )  # fmt: skip
        rows.append(new)
    card = replace(classifier.card, classes=[*classifier.card.classes, *names])
    state = classifier.state_dict() | _with_rows(classifier, layer, torch.cat(rows, dim=1), biases)
    state |= _with_limits(classifier, means)
    for name, new in zip(senses, rows, strict=True):  # a user's network keeps its own, unused
        own = None if fusion is None else score_layer_of(classifier.senses[name].network)
        if own is not None:
            state |= _with_rows(classifier, own, new, new.new_zeros(len(new)))
    grown = _rebuilt(card, state, statistics)
    for name, known in classifier.rows.items():
        counts = torch.tensor([len(rows) for rows in means[name]])
        labels = torch.arange(len(names)).repeat_interleave(counts) + len(classifier.card.classes)
        grown.rows[name] = cast(TrainingRows, known).with_recordings(torch.cat(means[name]), labels)
    return grown


def _check_extensible(classifier: SurfaceClassifier) -> ScoreLayer | nn.Linear:
    """Return the layer of the class scores, or reject a network that cannot be extended.

    Raises:
        UserError: Saying why.
    """
    if set(classifier.statistics) != {*classifier.card.sense_names}:
        raise UserError(
            "The checkpoint keeps no statistics of its features, which represent its old "
            "recordings; train it anew with task=fit."
        )
    if classifier.fusion is None:
        layer = score_layer_of(classifier.network)
        if layer is None:
            raise UserError(
                f"{type(classifier.network).__name__} of {classifier.card.kind} has no score_layer "
                "that is an nn.Linear or a convolution of kernel 1 with a bias, which classes "
                "could be added to; train it anew with all recordings."
            )
        return layer
    if "fc3" in classifier.fusion.levels:
        raise UserError(
            "This FusionNet fuses class scores, and classes are added to one that fuses FC2; train "
            "it anew with all recordings, or with model.fusion.level=fc2."
        )
    return classifier.fusion.head


def _means(recordings: Sequence[Tensor]) -> Tensor:
    """Return the mean features (recordings, D) of recordings, each (D, positions)."""
    return torch.stack([features.mean(dim=1) for features in recordings])


def _with_classes(known: FeatureStatistics, added: Sequence[Tensor]) -> FeatureStatistics:
    """Return statistics with more classes by the mean features (recordings, D) of each."""
    counts = torch.tensor([len(rows) for rows in added])
    return known.with_classes(torch.stack([rows.mean(dim=0) for rows in added]), counts)


def _with_rows(
    classifier: SurfaceClassifier, layer: nn.Module, rows: Tensor, biases: Tensor
) -> dict[str, Tensor]:
    """Return weight and bias of a layer with more rows, as the classifier's state names them."""
    (name,) = (name for name, module in classifier.named_modules() if module is layer)
    weight, bias = (classifier.state_dict()[f"{name}.{part}"] for part in ("weight", "bias"))
    return {
        f"{name}.weight": torch.cat([weight, rows.reshape(len(rows), *weight.shape[1:])]),
        f"{name}.bias": torch.cat([bias, biases]),
    }


def _with_limits(
    classifier: SurfaceClassifier, means: Mapping[str, Sequence[Tensor]]
) -> dict[str, Tensor]:
    """Return limits of gates, ranges and scores, widened by the features of the new classes."""
    widened: dict[str, Tensor] = {}
    for name, part in classifier.named_modules():
        if isinstance(part, RangeGate | FeatureRange | ScoreReach):
            sense = next(x for x in classifier.senses if name.startswith(f"senses.{x}."))
            rows = torch.cat([*means[sense]])
            widened |= {f"{name}.{key}": value for key, value in part.widened(rows).items()}
    return widened


def _rebuilt(
    card: Card, state: Mapping[str, Tensor], statistics: Mapping[str, FeatureStatistics]
) -> SurfaceClassifier:
    """Return the classifier with other classes.

    Raises:
        UserError: If something else in the network depends on their number.
    """
    extended = SurfaceClassifier(card)
    kept = {
        name: value
        for name, value in state.items()  # the scores of other recordings are of the old classes
        if not name.startswith((STATISTICS, ROWS))
        and not {SHORT, GAINLESS}.intersection(name.split("."))
    }
    try:
        extended.load_state_dict(kept)
    except RuntimeError as error:
        raise UserError(
            f"More of the {card.title} than its score layers depends on the classes; train it "
            "anew with all recordings."
        ) from error
    extended.statistics = nn.ModuleDict(statistics)
    return extended.eval()
