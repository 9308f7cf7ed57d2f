"""How fast is the operator beside its peers, how does that grow, and how far is it from what the machine can do?

    python benchmarks/performance.py [--shapes 1x512 64x128] [--only times threads memory] [--seconds 6] [--quick]
        [--vlfeat SOURCES] [--dlib SOURCES]

One thread, CPU time: the median over turns, in brackets the quartiles.  A ratio is the median of the peer's time over
ours in the same turn; bold is a loss.  *With backward* is the descriptor and its derivative with respect to the image;
no library has one, so it is compared with their descriptors without it.  The limit is the least time for the bytes and
the operations that a descriptor needs, see limits.py.  Memory is by how much one call raises the peak of the resident
set of a fresh process that holds the image (Linux only).
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Mapping
from pathlib import Path

import cv2
import torch

from limits import IMAGE, Rates, limits_ms, measured, work
from programs import NAIVE, PAPER, UOCTTI, Photographs, Program, add_libraries, library_options, programs
from timing import Summary, Times, cell, digits, in_turns, printed_by, processor, ratio, summary, table, times_as_fast

MAIN = ((1, 128), (1, 512), (64, 128), (1, 2048))
SHAPES = ((1, 64), *MAIN[:2], (16, 128), MAIN[2], (1, 1024), MAIN[3], (1, 4096))  # growing
COMPILED = ((1, 512), (64, 128))
LONGEST_MS = 4000.0  # of a call; what would take longer is left out
LEAST_TURNS, IN_A_ROW = 5, 5  # where only the shortest time counts; calls on as many threads


def shape_of(text: str) -> tuple[int, int]:
    """Images and pixels of a side, as of 64x128."""
    batch, side = map(int, text.split("x"))
    return batch, side


def in_words(batch: int, side: int) -> str:
    return f"{batch}×{side}²" if batch > 1 else f"{side}²"


def taking_part(program: Program, shape: tuple[int, int]) -> bool:
    shapes = {"main": MAIN, "compiled": COMPILED}
    return program.where == "all" or shape in shapes[program.where]


def operator(programs: list[Program], shape: tuple[int, int], seconds: float) -> dict[str, Times]:
    """Times of the programs on images of a shape."""
    photographs = Photographs(*shape)
    return in_turns({each.name: each.make(photographs) for each in programs}, seconds)


def ratios(program: Program, times: Mapping[str, Times]) -> dict[str, Summary]:
    """How many times as fast as each of its peers a program is."""
    return {name: ratio(times[name].cpu, times[program.name].cpu) for name in program.beside if name in times}


def times_table(every: list[Program], shapes: list[tuple[int, int]], seconds: float, rates: Rates) -> None:
    """Prints a table for each shape."""
    a_pixel: dict[str, float] = {}  # milliseconds at the shape before
    for batch, side in shapes:
        pixels = batch * side**2
        part = [each for each in every if taking_part(each, (batch, side))]
        slow = [each.name for each in part if a_pixel.get(each.name, 0) * pixels > LONGEST_MS]
        times = operator([each for each in part if each.name not in slow], (batch, side), seconds)
        rows = []
        for each in (one for one in part if one.name in times):
            cpu = summary(times[each.name].cpu)
            a_pixel[each.name] = cpu["median"] / pixels
            beside = ", ".join(f"{times_as_fast(stats)} {name}" for name, stats in ratios(each, times).items()) or "–"
            limit = "–"
            if each.spec is not None and each.where == "all":
                limit = f"{cpu['median'] / max(limits_ms(work(each.spec, each.backward), pixels, rates)):.1f}×"
            rows.append([each.name, cell(cpu), digits(1e6 * a_pixel[each.name]), limit, beside])
        head = ["program", "CPU ms", "ns a pixel", "times its limit", "times as fast as"]
        print(f"\n{in_words(batch, side)}\n\n{table(head, rows)}", flush=True)
        if slow:
            print(f"\nLeft out, as a call takes more than {LONGEST_MS / 1000:g} s: {', '.join(slow)}.")


def shortest_ms(program: Program, shape: tuple[int, int], seconds: float) -> dict[int, float]:
    """The least wall time by the number of threads; other times include waiting for a busy core."""
    counts = [2**k for k in range((os.cpu_count() or 1).bit_length())]
    call, least = program.make(Photographs(*shape)), dict.fromkeys(counts, float("inf"))
    end, turns = time.perf_counter() + seconds, 0
    while turns < LEAST_TURNS or time.perf_counter() < end:
        for count in counts:
            torch.set_num_threads(count)
            call()  # which wakes a core that had nothing to do
            times = Times()
            for _ in range(IN_A_ROW):
                times.add(call)
            least[count] = min(least[count], *times.wall)
        turns += 1
    torch.set_num_threads(1)
    return least


def threads_table(every: list[Program], shapes: list[tuple[int, int]], seconds: float) -> None:
    rows, counts = [], []
    for shape in (each for each in shapes if each in COMPILED):
        for program in every:
            if program.name.startswith(NAIVE) or (program.spec in (PAPER, UOCTTI) and program.where == "all"):
                least = shortest_ms(program, shape, seconds)
                counts = [f"{count} threads" if count > 1 else "1 thread" for count in least]
                cells = [f"{digits(ms)} ({least[1] / ms:.2f}×)" for ms in least.values()]
                rows.append([f"{program.name}, {in_words(*shape)}", *cells])
    print(f"\nShortest wall ms, and the speed-up over one thread\n\n{table(['program', *counts], rows)}", flush=True)


def memory_table(every: list[Program], side: int, options: argparse.Namespace) -> None:
    file, image = str(Path(__file__).with_name("programs.py")), side**2 * IMAGE / 2**20
    rows = []
    for each in (one for one in every if one.where != "compiled"):
        mib = printed_by(file, each.name, "1", str(side), *library_options(options))
        rows.append([each.name, *(["–"] * 2 if mib is None else [f"{mib:.1f}", f"{mib / image:.2f}"])])
    print(f"\nMemory of a call, {side}²\n\n{table(['program', 'MiB', f'images of {image:g} MiB'], rows)}", flush=True)


def limits_table(rates: Rates) -> None:
    sizes = [f"{size / 2**20:g} MiB" for size in rates.bandwidth]
    print(f"\n{table(['bytes moved', *sizes], [['GB/s', *(f'{r / 1e9:.0f}' for r in rates.bandwidth.values())]])}")
    counted = {"multiply-add": rates.fused, "division": rates.divisions, "square root": rates.roots}
    rows = [[name, f"{rate / 1e9:.1f}"] for name, rate in counted.items()]
    print(f"\n{table(['float32, in vectors', '10⁹ a second'], rows)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_libraries(parser)
    parser.add_argument("--shapes", type=shape_of, nargs="+", default=list(SHAPES), metavar="BATCHxSIDE")
    parser.add_argument("--only", nargs="+", default=("times", "threads", "memory"), metavar="PART")
    parser.add_argument("--seconds", type=float, default=6.0, help="for each shape, and each row of threads (6)")
    parser.add_argument("--quick", action="store_true", help="tiny images: does it run at all?")
    options = parser.parse_args()
    if options.quick:
        options.shapes, options.seconds = [(1, 64), (4, 32)], 0.1
    torch.set_num_threads(1)
    every = programs(options)
    print(f"torch {torch.__version__}, OpenCV {cv2.__version__}; {processor()}")
    if "times" in options.only:
        rates = measured()
        limits_table(rates)
        times_table(every, options.shapes, options.seconds, rates)
    if "threads" in options.only:
        threads_table(every, options.shapes, options.seconds / 2)
    if "memory" in options.only:
        memory_table(every, 256 if options.quick else 2048, options)


if __name__ == "__main__":
    main()
