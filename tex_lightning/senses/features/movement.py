"""Find where a tool moves in a signal: after the first touch, and without rests and knocks.

A recording goes on while the tool is lifted or stands still. What the sensor gives then is its own
noise, which tells nothing of the material, and would count like the movement. Neither does a bump
against something, which is so loud that every window that it is in holds little else.
"""

import torch
from torch import Tensor
from torch.nn.functional import pad

QUIET_SECONDS = 0.1  # the level before the touch is taken over this time
MIN_QUIET = 20  # samples that a level takes; at a lower rate no touch is looked for
IMPACT_FACTOR = 20.0  # a touch is this many times louder than the quiet before it
SETTLING_SECONDS = 0.2  # from the touch to steady movement
STEADY_FACTOR = 10.0  # steady movement is this many times louder than the quiet before the touch
SEARCH_SECONDS = 2.0  # later bursts are part of the movement
KNOWN_SECONDS = SEARCH_SECONDS + SETTLING_SECONDS + QUIET_SECONDS  # then nothing changes the start
MIN_BLOCK = 8  # samples
BLOCK_SECONDS = 0.05  # over which it is judged whether the tool moves
REST_SECONDS = 0.4  # a shorter pause, as where a stroke turns, belongs to the movement
REST_POWER = 0.002  # of the loud blocks' power; in a stroke it falls to 0.003 for 0.3 s at most
BUMP_POWER = 3.0  # of the power of fairly loud blocks, near a rest: the tool is picked up there
FAIRLY_LOUD = 8  # tenths of the blocks of movement that are quieter; of taps more are loud
KNOCK_POWER = 40.0  # of the power of loud blocks of the movement
KNOCK_BLOCKS = 40  # of which one may be a knock: more recur, and are what was recorded
LOUD = 9  # tenths of the blocks that are quieter than what is called loud: so many may be rest


def movement_start(trace: Tensor, sampling_rate: float) -> int:
    """Return first sample of steady movement: 0.2 s after a touch that breaks a quiet beginning.

    A recording that starts while the tool already moves has no such touch and is kept whole: a
    burst is a touch only if the 0.1 s of movement after it are louder than the beginning as well.

    Args:
        trace: (axes, samples).
        sampling_rate: Sampling rate in Hz.
    """
    quiet, settling = int(QUIET_SECONDS * sampling_rate), int(SETTLING_SECONDS * sampling_rate)
    search, known = int(SEARCH_SECONDS * sampling_rate), int(KNOWN_SECONDS * sampling_rate)
    trace = trace[:, :known].cpu()  # the sums are float64, which not every device has
    if quiet < MIN_QUIET or trace.shape[-1] < 2 * quiet + settling:
        return 0
    # the median is gravity or an offset: a mean would be drawn towards the movement
    centred = trace - trace[:, :quiet].median(dim=-1, keepdim=True).values
    strength = centred.square().sum(dim=0).sqrt()
    level = strength[:quiet].mean()
    burst = strength[quiet:search] > IMPACT_FACTOR * level
    if not burst.any():  # before sums that take longer
        return 0
    after = strength[quiet + settling :].double().cumsum(0)  # a later sample changes no sum
    steady = after[quiet:] - after[:-quiet] > STEADY_FACTOR * level * quiet
    touches = (burst[: len(steady)] & steady[: len(burst)]).nonzero()
    return quiet + int(touches[0]) + settling if len(touches) else 0


def block_length(sampling_rate: float) -> int:
    """Return the samples of a block: those of 0.05 s, but at least 20, or what 0.1 s have, or 8."""
    few = min(MIN_QUIET, int(QUIET_SECONDS * sampling_rate))
    return max(MIN_BLOCK, few, int(BLOCK_SECONDS * sampling_rate))


def left_out(trace: Tensor, sampling_rate: float) -> Tensor:
    """Return which samples (samples,) of a signal (axes, samples) belong to a rest or a knock.

    It can be traced for export; arguments are those of :func:`left_out_blocks`.
    """
    out = left_out_blocks(trace, sampling_rate)
    return of_samples(out, trace.shape[-1], block_length(sampling_rate))


def left_out_blocks(trace: Tensor, sampling_rate: float) -> Tensor:
    """Return which blocks (blocks,) of a signal belong to a rest, or are a knock.

    A rest is at least 0.4 s of blocks whose power without their mean is far below that of the loud
    ones, with what is within 0.2 s of it and louder than the movement. A knock is a block far above
    the loud ones of the movement, with those beside it, if only one in two seconds is.

    Args:
        trace: (axes, samples), at least one block long.
        sampling_rate: Sampling rate in Hz.
    """
    length = block_length(sampling_rate)
    power = block_power(trace, length)
    limits = power_limits(power.sort().values)
    return rests_and_knocks(power, *limits, run_length(sampling_rate, length))


def power_limits(ordered: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return below which power () blocks may be a rest, and above which a bump and a knock.

    Args:
        ordered: Power (blocks,) of all blocks, in order of size.
    """
    last = ordered.shape[0] - 1
    rest = REST_POWER * ordered[LOUD * last // 10]
    quiet = (ordered < rest).sum()
    loud = ordered.index_select(0, (quiet + LOUD * (last - quiet) // 10)[None])[0]
    knocks = (ordered > KNOCK_POWER * loud).sum()
    few = KNOCK_BLOCKS * knocks <= last + 1 - quiet
    fairly = ordered.index_select(0, (quiet + FAIRLY_LOUD * (last - quiet) // 10)[None])[0]
    return rest, BUMP_POWER * fairly, torch.where(few, KNOCK_POWER * loud, torch.inf)


def rests_and_knocks(
    power: Tensor, rest: Tensor | float, bump: Tensor | float, knock: Tensor | float, run: int
) -> Tensor:
    """Return which blocks (blocks,) of some power are in a rest, or in or beside a knock.

    Args:
        power: (blocks,).
        rest: Power below which ``run`` blocks in a row are a rest.
        bump: Power above which one belongs to a rest that is half a run away at most.
        knock: Power above which one is a knock.
        run: Number of blocks.
    """
    rests = in_runs(power < rest, run)
    bumps = around(rests, reach(run)) & around(power > bump, 1)
    return rests | bumps | around(power > knock, 1)


def reach(run: int) -> int:
    """Return how many blocks beside a rest may belong to it."""
    return max(1, run // 2)


def around(blocks: Tensor, count: int) -> Tensor:
    """Return which blocks (blocks,) are at most ``count`` away from one of these."""
    return sums(pad(blocks.long(), (count, count)), 2 * count + 1) > 0


def of_samples(blocks: Tensor, samples: int, length: int) -> Tensor:
    """Return for each of the samples what is true of its block, or of the last whole one."""
    block = torch.arange(samples, device=blocks.device) // length
    return blocks[block.clamp(max=blocks.shape[0] - 1)]


def run_length(sampling_rate: float, length: int) -> int:
    """Return how many blocks of so many samples the shortest rest has."""
    return max(1, round(REST_SECONDS * sampling_rate / length))


def block_power(trace: Tensor, length: int) -> Tensor:
    """Return the power (blocks,) of whole blocks of a signal (axes, samples), without means."""
    count = trace.shape[-1] // length
    blocks = trace[:, : count * length].reshape(trace.shape[0], count, length)
    around = blocks - blocks.mean(dim=-1, keepdim=True)  # much faster than torch.var
    return around.square_().mean(dim=-1).sum(dim=0)


def in_runs(quiet: Tensor, run: int) -> Tensor:
    """Return which blocks (blocks,) are in ``run`` quiet ones in a row."""
    padded = pad(quiet.long(), (run - 1, run - 1))  # sums of floats differ each time on a GPU
    return sums((sums(padded, run) == run).long(), run) > 0


def sums(values: Tensor, length: int) -> Tensor:
    """Return the sum of every ``length`` neighbours of (n,): (n - length + 1,)."""
    total = pad(values.cumsum(dim=0), (1, 0))
    return total[length:] - total[:-length]


def moving(trace: Tensor, sampling_rate: float, *, pieces: bool = True) -> Tensor:
    """Return the movement in a signal: from its start on, and without rests and knocks.

    Args:
        trace: (axes, samples).
        sampling_rate: Sampling rate in Hz.
        pieces: Also leave out what is in the middle; else only what is at the end, so that a
            sample's number still tells its time.
    """
    trace = trace[:, movement_start(trace, sampling_rate) :]
    if trace.shape[-1] < block_length(sampling_rate):
        return trace
    blocks = left_out_blocks(trace, sampling_rate)
    if not bool(blocks.any()):
        return trace
    out = of_samples(blocks, trace.shape[-1], block_length(sampling_rate))
    kept = (~out).nonzero()[:, 0]
    return trace[:, kept] if pieces else trace[:, : int(kept[-1]) + 1]
