"""Fit rows of a score layer to few recordings of new classes and none of the old ones.

The old classes are represented by features drawn from their statistics. The new rows are
fitted by logistic regression while the old ones stay as they are: nothing changes among the old
classes. Nearest means, linear discriminants and weights imprinted from the mean feature do worse
(docs/enrolment.md).
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tex_lightning.classifier.statistics import FeatureStatistics

Fragments = Sequence[Sequence[Tensor]]  # by class and recording, features (D, positions)

DRAWN = 60  # features of each class that stand for its recordings
FRAGMENTS = 200  # of a recording that are looked at, at most
STRENGTH = 1e-6  # of the penalty on a row's squared length, times the spread of the means
STEPS = 200


def fit_rows(
    statistics: FeatureStatistics,
    weight: Tensor,
    bias: Tensor,
    features: Fragments,
    *,
    temperature: float,
    new_bias: float | None,
) -> tuple[Tensor, Tensor]:
    """Weights (added, D) and biases (added,) of the new classes.

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
        found = (shares * errors).sum() / (known + added) + penalty * rows.square().sum()
        found.backward()  # type: ignore[no-untyped-call]  # no annotation in PyTorch
        return found

    optimizer.step(loss)  # type: ignore[no-untyped-call]  # likewise
    weights = statistics.whiten(rows.detach())
    return weights, biases.detach() - weights @ origin


def _examples(statistics: FeatureStatistics, features: Fragments) -> tuple[Tensor, Tensor, Tensor]:
    """Features (N, D), their classes and what each counts for; all classes count alike.

    Of every class features are drawn as those of recordings are distributed, and moved as the
    fragments of the new recordings lie about the mean of theirs: fragments are what will vote. The
    new fragments themselves count as much again.
    """
    generator = torch.Generator().manual_seed(0)
    recordings = [each for own in features for each in own]
    apart = torch.cat([_some(each - each.mean(dim=1, keepdim=True)) for each in recordings])
    drawn = statistics.draw(DRAWN, generator)
    drawn = drawn + apart[torch.randint(len(apart), drawn.shape[:2], generator=generator)]
    groups = list(enumerate(drawn))
    for number, own in enumerate(features, start=len(drawn) - len(features)):
        groups.append((number, torch.cat([_some(each) for each in own])))
    times = torch.tensor([number for number, _ in groups]).bincount().tolist()
    labels = torch.cat([torch.full((len(each),), number) for number, each in groups])
    shares = [torch.full((len(each),), 1 / (len(each) * times[number])) for number, each in groups]
    return torch.cat([each for _, each in groups]), labels, torch.cat(shares)


def _some(features: Tensor) -> Tensor:
    """Fragments (n, D) of a recording's features (D, positions), evenly spread."""
    step = -(-features.shape[1] // FRAGMENTS)
    return features[:, ::step].T
