"""How many of sixty one-line faults the tests find.

``python -m benchmarks mutants``, or ``--only=3,14`` for some of them. The list is fixed and was
picked by hand, mostly from lines that compute or decide, shuffled with the seed 0: an end
that is off by one, a swapped axis, a wrong sign, another sample's label. Each is put into a copy of
the checkout, and the test files that belong to the module run until the first failure. A line is
found by its content, and by a part of its path where several are alike; one that there is no
longer counts as gone, and one whose tests take too long as undecided.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 400  # for the tests of one fault
FAULTS = """
== min(len(groups), count) ==> <= min(len(groups), count)
(row.fold - fold) % folds, ==> (row.fold - fold - 1) % folds,
members[i % len(members)] for name ==> members[0] for name
("train", "test") if by.inverted ==> ("test", "train") if by.inverted
"val" if row.fold == by.val_fold else ==> "val" if row.fold != by.val_fold else
data/decode: ratio.numerator, ratio.denominator, ==> ratio.denominator, ratio.numerator,
constant = low == high ==> constant = low != high
[n / totals[kind] for kind, n in ==> [n for kind, n in
parts if min(seen.values()) > 1 else ==> parts if min(seen.values()) > 0 else
- features.mean) / features.std ==> - features.mean) * features.std
samples - self.window_length) // self.hop_length + 1 ==> samples) // self.hop_length + 1
features/spectrogram: frames = frames - frames.mean(dim=-1, keepdim=True) ==> frames = frames
(frequencies - below) / (centres - below) ==> (frequencies - below) / (centres + below)
std = self._mean(count - 1, away).sqrt() ==> std = self._mean(count - 1, away)
(squares[..., 0] + squares[..., 1]).sum(dim=0) ==> (squares[..., 0] - squares[..., 1]).sum(dim=0)
features/proportions: bands - bands.mean(dim=1, keepdim=True) ==> bands - bands.mean()
scale = window.sum().square() * self.level ==> scale = window.sum() * self.level
- (patch - 1) / 2) / half ==> - patch / 2) / half
torch.fft.rfft(trace - trace.mean(dim=-1, keepdim=True)) ==> torch.fft.rfft(trace)
(high - low) / (2**bits - 1) ==> (high - low) / 2**bits
(decibel - decibel / 2 * decades) / 20) ==> (decibel - decibel / 2 * decades) / 10)
/ strength / 10 ** (snr / 10)) ==> / strength / 10 ** (snr / 20))
Window(kernel, stride, (kernel - stride) // 2, ==> Window(kernel, stride, kernel // 2,
.bias"] = shift - scale * mean ==> .bias"] = shift + scale * mean
weight = weight.flip(1) ==> weight = weight.flip(0)
last = (last - 1) * window.stride ==> last = last * window.stride
networks: total = total + part ==> total = total - part
if index == len(self.sizes) - 1 ==> if index < len(self.sizes)
(1 + 1 / self.counts).sqrt() ==> (1 / self.counts).sqrt()
rows - means[labels], len(rows) - classes ==> rows - means[labels], len(rows)
return classifier.eval() ==> return classifier
= probabilities(logits, temperature), ==> = probabilities(logits, 1.0),
label=int(self.probabilities.argmax()) ==> label=int(self.probabilities.argmin())
int((len(known) + 1) * rate + ==> int(len(known) * rate +
torch.full((count, classes), rest / (classes - 1), ==> torch.full((count, classes), rest / classes,
return torch.stack(drawn, dim=1) ==> return torch.stack(drawn[::-1], dim=1)
last.scale.fill_(1) ==> last.scale.fill_(2)
sense.network.eval()  # and stays ==> sense.network.train()  # and stays
rows = (rows - mean) * scale * share ==> rows = rows * scale * share
biases.detach() - weights @ origin ==> biases.detach() + weights @ origin
/ (known + added) + penalty ==> / (known + added) - penalty
(draw * len(parts) / dropout).long() ==> (draw * len(parts)).long()
"lr": rate * fit["head_factor"] ==> "lr": rate / fit["head_factor"]
cross_entropy(scores.T, label.expand( ==> cross_entropy(-scores.T, label.expand(
f"{self.digest} {corner} {view.shape}" ==> f"{self.digest}"
means[0] - means[1] <= error + ROUNDING ==> means[0] - means[1] <= 4 * error + ROUNDING
sum(p * (1 - p) / n for ==> sum(p * (1 - p) for
self.targets[out] - torch.linalg.solve( ==> self.targets[out] + torch.linalg.solve(
(targets - self.share) * self.root ==> targets * self.root
vote.probability < least ==> vote.probability > least
shift + scale * conv.bias.double() ==> shift + conv.bias.double()
cepstrum[:, self.first - 1 : self.last] ==> cepstrum[:, self.first : self.last]
- 2 * features @ (means * precision).T ==> - features @ (means * precision).T
self.network.eval() ==> self.network.train()
basic = ~self._are(OPTIONAL) ==> basic = self._are(OPTIONAL)
outputs["novelty"].double() > self.card ==> outputs["novelty"].double() < self.card
features/proportions: return member / member.sum(dim=0) ==> return member
lengths * WINDOWS_IN_RECORDING <= shortest ==> lengths <= shortest
if len(layer.sizes) - 1 not in indices ==> if len(layer.sizes) - 1 in indices
classifier/card: weights_only=True ==> weights_only=False
""".strip().splitlines()


def measure(only: str = "", tree: str = str(ROOT)) -> dict[str, Any]:
    """Count the faults that tests found, and name those that they did not.

    Args:
        only: Numbers of faults, separated by commas; else all.
        tree: The checkout that is tested.
    """
    found: dict[str, list[int]] = {"caught": [], "survived": [], "undecided": [], "gone": []}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(tree, copy, ignore=shutil.ignore_patterns(".git", ".*_cache", "outputs"))
        for number in map(int, only.split(",") if only else range(len(FAULTS))):
            outcome = _try(copy, FAULTS[number])
            found[outcome].append(number)
            print(number, outcome, FAULTS[number], file=sys.stderr, flush=True)
    return {
        **{name: len(numbers) for name, numbers in found.items()},
        "surviving": {str(number): FAULTS[number] for number in found["survived"]},
    }


def _try(copy: Path, fault: str) -> str:
    old, new = fault.split(" ==> ")
    hint, old = re.fullmatch(r"(?:([a-z_/]+): )?(.*)", old).groups()  # type: ignore[union-attr]
    texts = {path: path.read_text() for path in sorted(copy.glob("tex_lightning/**/*.py"))}
    having = [path for path, text in texts.items() if old in text]
    if not having:
        return "gone"
    module = max(having, key=lambda path: f"tex_lightning/{hint}" in path.as_posix())
    module.write_text(texts[module].replace(old, new, 1))
    try:
        return _judge(copy, module)
    finally:
        module.write_text(texts[module])


def _judge(copy: Path, module: Path) -> str:
    """What the tests of a module say: its own file first, then its package's and users'."""
    name = ".".join(module.relative_to(copy).with_suffix("").parts)
    package = copy / "tests" / module.parent.name
    using = re.compile(rf"{re.escape(name)}\b")
    files = [path for path in copy.glob("tests/**/test_*.py") if using.search(path.read_text())]
    own = package / f"test_{module.stem}.py"
    files = sorted({*files, *package.glob("test_*.py")}, key=lambda path: (path != own, path))
    command = ["-m", "pytest", "-q", "-x", "-n0", "-pno:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": f"{copy}:{copy / 'runtime'}", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, *command, *map(str, files)],
            cwd=copy, env=environment, capture_output=True, timeout=SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "undecided"
    return "caught" if done.returncode else "survived"
