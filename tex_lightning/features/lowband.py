"""The low channels of a spectrogram as a few small matrix products.

A Fourier transform of every frame computes all channels and repeats each sample for every frame
that covers it. HapticNet reads the lowest fifth of the channels only, and then two facts save most
of the work. A stretch of one hop (100 samples, 10 ms) says nothing about the band below 1 kHz that
34 numbers do not say: the transform restricted to one hop has this rank, as far as single precision
can tell (Landau, Pollak and Slepian's count of 2BT and a few). So every hop is projected once, for
all frames that share it. And the window is symmetric, so with the phase taken at the middle of the
frame the cosines see only what the frame has in common with its mirror image, and the sines only
what differs: half of the products each.
"""

import math
from functools import cache

import torch
from torch import Tensor, nn

PRECISION = 1e-7  # singular values below it, relative to the largest, are left out


class LowBand(nn.Module):
    """Power spectra of overlapping frames in the channels below ``bands``.

    Args:
        window: (samples,) symmetric; an odd number of hops.
        hop: Samples from frame to frame, even.
        bands: Channels, counted from 0 Hz.
        centred: Whether each frame has its own mean removed before the window.
    """

    basis: Tensor
    sign: Tensor
    cosines: Tensor
    sines: Tensor

    def __init__(self, window: Tensor, hop: int, bands: int, *, centred: bool) -> None:
        super().__init__()
        self.hop = hop
        self.span = len(window) // hop
        basis, sign, cosines, sines = _matrices(tuple(window.tolist()), hop, bands, centred)
        self.even = int((sign > 0).sum())
        self.register_buffer("basis", basis, persistent=False)
        self.register_buffer("sign", sign, persistent=False)
        self.register_buffer("cosines", cosines, persistent=False)
        self.register_buffer("sines", sines, persistent=False)

    def forward(self, hops: Tensor) -> Tensor:
        """Squared magnitudes of all frames of a signal.

        Args:
            hops: (count, hop), the signal cut into hops.

        Returns:
            (bands, count - span + 1), not negative; column ``t`` is the frame from hop ``t`` on.
        """
        frames = len(hops) - self.span + 1
        numbers = self.basis @ hops.T
        mirrored = numbers * self.sign
        middle = numbers[:, self.span // 2 :][:, :frames]  # its own mirror image
        real = self.cosines[-1][:, : self.even] @ middle[: self.even]
        imaginary = self.sines[-1][:, self.even :] @ middle[self.even :]
        for place in range(self.span // 2):
            first = numbers[:, place : place + frames]
            last = mirrored[:, self.span - 1 - place :][:, :frames]
            real.addmm_(self.cosines[place], first + last)
            imaginary.addmm_(self.sines[place], first - last)
        return real.square_().addcmul_(imaginary, imaginary)


@cache
def _matrices(
    window: tuple[float, ...], hop: int, bands: int, centred: bool
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The hop's basis (rank, hop), its parity (rank, 1), and (places, bands, rank) twice.

    The even shapes come first. The places are the hops of half a frame, the middle one last.
    """
    samples = len(window)
    time = torch.arange(samples, dtype=torch.float64) - (samples - 1) / 2
    angle = 2 * math.pi / samples * time * torch.arange(bands, dtype=torch.float64)[:, None]
    weights = torch.stack((angle.cos(), angle.sin())) * torch.tensor(window, dtype=torch.float64)
    if centred:
        weights -= weights.mean(dim=-1, keepdim=True)
    pieces = weights.view(2, bands, -1, hop)  # (2, bands, hops of a frame, hop)
    table = pieces.flatten(0, 2)
    parts, parity = [], []
    for sign in (1.0, -1.0):
        half = (table + sign * table.flip(1))[:, : hop // 2]
        _, size, shapes = torch.linalg.svd(half, full_matrices=False)
        shapes = shapes[size > PRECISION * size[0]] / math.sqrt(2)
        parts.append(torch.cat((shapes, sign * shapes.flip(1)), dim=1))
        parity += [sign] * len(shapes)
    basis = torch.cat(parts)
    products = (pieces @ basis.T)[:, :, : pieces.shape[2] // 2 + 1].transpose(1, 2)
    cosines, sines = products.float().contiguous()
    return basis.float(), torch.tensor(parity)[:, None], cosines, sines
