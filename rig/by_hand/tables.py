"""Looks on the terminal."""

from __future__ import annotations

from rig.by_hand.look import Look, LookRequest, WatchedLens, watch
from rig.by_hand.photograph import PhotographFigures
from rig.terminal import print_table, say
from rig.terminal.line import OverwrittenLine, bar, counted

_BAR = 30
"""Characters of the longest bar of a histogram."""


def print_look(look: Look) -> None:
    """Print the figures of a photograph: levels, clipping, histogram, sharpness by parts."""
    figures = look.figures
    rows = [
        ("exposure [ms]", 1000 * look.exposure_s),
        ("mean [% of full scale]", 100 * figures.mean),
        ("brightest permille [% of full scale]", 100 * figures.brightest),
        ("clipped [% of the pixels]", 100 * figures.clipped_share),
        ("at zero [% of the pixels]", 100 * figures.black_share),
        ("sharpness (more is sharper)", figures.sharpness),
    ]
    told = f", taken as {look.profile}" if look.profile else ""
    print_table(f"{look.width_px} x {look.height_px} px of {look.picture!r}{told}", ("", "value"), rows)
    highest = max(figures.histogram)
    bins = [
        (f"{100 * k / len(figures.histogram):.0f} %", 100 * share, bar(share / highest, _BAR))
        for k, share in enumerate(figures.histogram)
    ]
    print_table("Histogram", ("from", "% of the pixels", "share"), bins)
    print_table("Sharpness by part of the picture", ("left", "middle", "right"), figures.sharpness_by_part)
    for word in advice(figures):
        say(word)
    if look.photograph is not None:
        print(f"photograph: {look.photograph}")


def advice(figures: PhotographFigures) -> list[str]:
    """Return what the figures ask for, in words."""
    words = []
    if figures.clipped_share > 0.001:
        words.append(f"{100 * figures.clipped_share:.1f} % of the pixels are clipped: give a shorter --exposure")
    if figures.brightest < 0.1:
        words.append("the photograph is dark: give a longer --exposure, open the iris, or look whether the lamp is on")
    if figures.sharpness is None:
        words.append("too dark to say how sharp it is")
    return words


def watched(request: LookRequest, seconds: float | None) -> WatchedLens:
    """Watch with a line on stderr that each photograph writes over."""
    with OverwrittenLine() as line:
        line("first photograph; turn the focus until the figure is highest, q ends it")
        return watch(request, lambda look, best: line(line_of(look, best)), seconds=seconds)


def line_of(look: Look, best: float | None) -> str:
    """Return a line of a watched lens: how sharp now, how sharp at best."""
    now = look.figures.sharpness
    if now is None or not best:
        return f"too dark to say how sharp it is ({100 * look.figures.brightest:.0f} % of full scale)"
    clipped = f", {100 * look.figures.clipped_share:.1f} % clipped" if look.figures.clipped_share > 0.001 else ""
    return f"sharpness {now:.3f} {bar(now / best, _BAR)} best so far {best:.3f}{clipped}"


def print_watched(seen: WatchedLens) -> None:
    """Print what a watched lens came to."""
    if seen.best is None or seen.last is None:
        print(f"{counted(seen.looks, 'photograph')}, all or the last too dark to say how sharp")
        return
    print(f"{counted(seen.looks, 'photograph')}: sharpness {seen.last:.3f} at the end, {seen.best:.3f} at best")
