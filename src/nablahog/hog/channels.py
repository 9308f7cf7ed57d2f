"""The channels of a descriptor: of the mirrored image, in another library's order, or some of them."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .inputs import Descriptors, descriptor_tensor, to_array
from .normalizers import PARTS, FourBlockNorm, Part
from .normalizers.four_block import VLFEAT_TEXTURE
from .orientation import bin_angles
from .presets import as_spec
from .spec import HOGSpec

# what says where gradients are counted and what an entry is; other fields matter at borders, at ties, or through ε
_SAME = ("colour", "bin_offset", "counterclockwise", "cell_size", "vote", "gamma", "mask")


def channel_names(spec: HOGSpec | str) -> tuple[str, ...]:
    """What each channel of a descriptor is, for readers, in the order of channels.

    Orientations are directions of gradients in degrees, from +x towards +y, down.

    Args:
        spec: the dialect, or the name of a preset with its defaults.

    Raises:
        ValueError: there is no such preset.

    >>> from nablahog.hog.channels import channel_names
    >>> names = channel_names("uoctti")
    >>> names[0], names[18], names[27]
    ('directed: 0°', 'undirected: 0°', 'texture: block up-left')
    """
    spec = as_spec(spec)
    bins = [f"{round(math.degrees(angle) % (360 if spec.signed else 180), 1):g}°" for angle in bin_angles(spec)]
    names = spec.normalizer.channel_names(bins, bins[: _axes(spec)])
    colours = [""] if spec.colours == 1 else ["red, ", "green, ", "blue, "]
    return tuple(f"{colour}{name}" for colour in colours for name in names)


def convert_channels(descriptor: Descriptors, source: HOGSpec | str, target: HOGSpec | str) -> Descriptors:
    """The channels that another four-block dialect has, in its order, if they are exactly those at hand.

    Directed and undirected channels mean the same in all of them: VLFeat's 31 become DPM's first 27, DPM's 32 dlib's
    31 and back.  Channels can be left out, the zero added, and blocks of a ``"dalaltriggs"`` summed to undirected and
    texture channels.  Only the channels change.  How each library treats the borders of images and cells that are cut
    by them, ties, and the range of values stays the source's.

    Args:
        descriptor: (..., channels) of ``source``, tensor or array.
        source: the dialect it is of, or the name of a preset with its defaults.
        target: the dialect whose channels to make of it, likewise.

    Returns:
        (..., channels) of ``target``, of the kind, dtype and device of ``descriptor``; linear in it.

    Raises:
        ValueError: ``target`` has channels that cannot be made exactly: directed or undirected ones that are not
            there, or another library's texture; its histograms or clip are others; a dialect is not four-block; the
            shape is not the source's; or there is no such preset.

    >>> dpm, dlib = nablahog.presets.dpm(), nablahog.presets.dlib()
    >>> descriptor = nablahog.hog(torch.rand(1, 1, 64, 64), dpm)
    >>> nablahog.convert_channels(descriptor, dpm, dlib).shape[-1], descriptor.shape[-1]
    (31, 32)
    """
    source, target = as_spec(source), as_spec(target)
    if not isinstance(descriptor, Tensor):
        return to_array(convert_channels(descriptor_tensor("the descriptor", descriptor), source, target))
    parts, scheme, goal = _split(descriptor, source), _four_block(source), _four_block(target)
    ours, theirs = ({**{n: getattr(s, n) for n in _SAME}, "orientations": _axes(s)} for s in (source, target))
    ours["clip"], theirs["clip"] = scheme.clip, goal.clip
    for name, value in ours.items():
        if value != theirs[name]:
            raise ValueError(
                f"{source.named} descriptor has no channels of {target.named} one: its {name} is {value!r}, not "
                f"{theirs[name]!r}"
            )
    made = _made(parts, scheme, _axes(source))
    channels = []
    for part in goal.parts:
        kind = f"{goal.texture} texture" if part == "texture" else part
        if kind not in made:
            raise ValueError(f"the {kind} channels of {target.name} cannot be made exactly of those of {source.name}")
        channels.append(made[kind])
    return torch.cat(channels, dim=-1).flatten(-2)


def _made(parts: dict[Part, Tensor], scheme: FourBlockNorm, axes: int) -> dict[str, Tensor]:
    """All channels that can be computed from a descriptor's parts (..., colours, n)."""
    made: dict[str, Tensor] = {f"{scheme.texture} texture" if p == "texture" else p: x for p, x in parts.items()}
    made["zero"] = torch.zeros_like(next(iter(parts.values()))[..., :1])
    if "blocks" in parts:
        blocks = parts["blocks"].reshape(*parts["blocks"].shape[:-1], 4, axes)
        made.setdefault("undirected", blocks.sum(dim=-2) / 2)
        made.setdefault("vlfeat texture", blocks.sum(dim=-1) * VLFEAT_TEXTURE)
    return made


def _split(descriptor: Tensor, spec: HOGSpec) -> dict[Part, Tensor]:
    """A descriptor (..., channels) by its parts, each (..., colours, n)."""
    scheme = _four_block(spec)
    if descriptor.dim() < 1 or descriptor.shape[-1] != spec.channels:
        raise ValueError(
            f"{spec.named} descriptor has {spec.channels} channels in its last dimension, got the shape "
            f"{tuple(descriptor.shape)}"
        )
    of_colours = descriptor.reshape(*descriptor.shape[:-1], spec.colours, -1)
    return scheme.split(of_colours, spec.bins, spec.signed, dim=-1)


def _four_block(spec: HOGSpec) -> FourBlockNorm:
    if not isinstance(spec.normalizer, FourBlockNorm):
        raise ValueError(
            f"the channels of {spec.name} are no {', '.join(PARTS)}: only a four-block normaliser makes these"
        )
    return spec.normalizer


def _axes(spec: HOGSpec) -> int:
    """Undirected orientations over 180°."""
    return spec.bins // 2 if spec.signed else spec.bins
