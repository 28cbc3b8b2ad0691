"""palpate bench: measure the inversion on simulated contacts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.command import Command
from palpate.cli.examples import example
from palpate.cli.files import Force, check_output, check_outputs, make_folder, save_figure, write_text
from palpate.cli.methods import MethodCommand, chosen_method
from palpate.cli.progress import Bar
from palpate.errors import InvalidInput

bench_app = typer.Typer(
    help="Measure the inversion on simulated contacts. Each of these takes minutes to hours; --quick takes less than a minute.",
    epilog=example("bench accuracy"),
    invoke_without_command=True,
    rich_markup_mode=None,
)


@bench_app.callback()
def _bench(ctx: typer.Context) -> None:
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


@bench_app.command("accuracy", cls=MethodCommand, epilog=example("bench accuracy"))
def bench_accuracy(
    ctx: typer.Context,
    layouts: Annotated[str | None, typer.Option(help="Layouts, separated by commas; default: all.")] = None,
    draws: Annotated[int, typer.Option(min=1, help="Noise draws of each contact.")] = 2,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    comparisons: Annotated[bool, typer.Option(help="Also the methods for comparison.")] = True,
    quick: Annotated[
        bool, typer.Option("--quick", help="Lines alone, one draw, no methods for comparison: less than a minute.")
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the table of every case (accuracy.csv), the tables of a page (accuracy.md) and the picture (accuracy.png)."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Compare the error of a method with that of the best linear filter, and count how often its error bars hold the truth.

    The filter is Wiener's, which knows the contact's spectrum and the noise. Without --method the automatic method is
    measured; without --quick beside the methods for comparison.
    """
    import csv
    import io

    from palpate import bench

    method = chosen_method(ctx)
    if quick:
        layouts, draws, comparisons = layouts or "line", 1, False
    names = tuple(bench.LAYOUTS) if layouts is None else tuple(n.strip() for n in layouts.split(","))
    unknown = [n for n in names if n not in bench.LAYOUTS]
    if unknown:
        raise InvalidInput(f"layouts must be among {', '.join(bench.LAYOUTS)}; got {', '.join(unknown)}.")
    folder = make_folder(out) if out is not None else None
    if folder is not None:
        for name in ("accuracy.csv", "accuracy.md", "accuracy.png"):
            check_output(folder / name, force=force)
    total = sum(
        len(bench.LAYOUTS[n].contacts)
        * len(bench.NOISES)
        * draws
        * len(bench.measured(bench.LAYOUTS[n], method, comparisons=comparisons))
        for n in names
    )
    with Bar("contacts", total) as step:
        records = bench.accuracy(
            names,
            draws=draws,
            seed=seed,
            method=method,
            comparisons=comparisons,
            jobs=jobs,
            report=lambda record: step(record.contact),
        )
    typer.echo("error over that of the clairvoyant Wiener filter, which knows the contact's spectrum and the noise")
    wide = max(13, 2 + max(len(r.method) for r in records))
    typer.echo(f"{'layout':<21}{'method':<{wide}}{'noise':>7}{'geometric mean':>16}{'worst':>8}{'contacts':>10}")
    for layout, name, noise, mean, worst, count in bench.table(records):
        level = "all" if noise != noise else f"{noise:g}"
        typer.echo(f"{layout:<21}{name:<{wide}}{level:>7}{mean:>16.3f}{worst:>8.3f}{count:>10}")
    label = bench.DEFAULT if method is None else str(method)
    half, most = bench.coverage(records, 0.5, label), bench.coverage(records, 0.95, label)
    typer.echo(f"part of true values inside the intervals ({label})" if half else f"{label} has no error bars")
    for quantity, value in half.items():
        typer.echo(f"{quantity:<21}50 %: {value:.3f}   95 %: {most[quantity]:.3f}")
    if folder is not None:
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        writer.writerow(["layout", "contact", "noise", "method", "error", "clairvoyant"])
        writer.writerows([r.layout, r.contact, r.noise, r.method, r.error, r.clairvoyant] for r in records)
        write_text(folder / "accuracy.csv", table.getvalue())
        chosen = "" if method is None else f" --method {method}"
        alone = "" if comparisons else " --no-comparisons"
        command = f'palpate bench accuracy{chosen} --layouts "{",".join(names)}" --draws {draws} --seed {seed}{alone}'
        write_text(folder / "accuracy.md", bench.accuracy_markdown(records, command=command))
        from palpate._plot import plot_accuracy

        save_figure(plot_accuracy(records), folder / "accuracy.png")
        typer.echo(f"wrote           {folder / 'accuracy.csv'}, {folder / 'accuracy.md'}, {folder / 'accuracy.png'}")


@bench_app.command("ablation", cls=Command, epilog=example("bench ablation"))
def bench_ablation(
    frames: Annotated[int, typer.Option(min=2, help="Random frames; each is solved some twenty times.")] = 40,
    numbers: Annotated[
        int,
        typer.Option(
            min=0,
            help="Frames on which each number of the method is also halved and doubled (thirty times as much work).",
        ),
    ] = 10,
    kinds: Annotated[
        str, typer.Option(help="Kinds of contact, in turn, separated by commas: line, area, area with shear.")
    ] = "line,line,area,area with shear",
    seed: Annotated[int, typer.Option(help="Seed of the frames.")] = 2024,
    minutes: Annotated[
        float | None,
        typer.Option(help="Minutes after which no frame is begun; the table says how many frames were solved."),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Ten lines, no numbers: less than a minute.")] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Markdown file for the table.")] = None,
    force: Force = False,
) -> None:
    """Measure the contribution of each part of the automatic method, on contacts that tuned nothing."""
    from palpate import bench

    if quick:
        frames, numbers, kinds = 10, 0, "line"
    names = tuple(k.strip() for k in kinds.split(","))
    unknown = [k for k in names if k not in bench.CONTACT_KINDS]
    if unknown:
        raise InvalidInput(f"kinds must be among {', '.join(bench.CONTACT_KINDS)}; got {', '.join(unknown)}.")
    if numbers > frames:
        raise InvalidInput(f"--numbers must not exceed --frames ({frames}); got {numbers}.")
    if minutes is not None and not (math.isfinite(minutes) and minutes > 0):
        raise InvalidInput(f"--minutes must be a positive number; got {minutes:g}.")
    if out is not None:
        check_output(out, force=force)
    seconds = None if minutes is None else 60.0 * minutes
    with Bar("frames", frames) as step:
        found = bench.ablation(
            frames,
            numbers=numbers,
            kinds=names,
            seed=seed,
            seconds=seconds,
            jobs=jobs,
            report=lambda i: step(f"{i}"),
        )
    rows = bench.summary(found)
    frames, numbers = len(found), min(numbers, len(found))  # number of columns of the table
    if not rows:
        raise InvalidInput(f"nothing touches in any of the {frames} frames of seed {seed}; give more with --frames.")
    typer.echo(
        f"{'error over that of the whole method':<52}{'mean':>7}{'95 % interval':>16}{'worst':>8}{'force in':>10}{'time':>7}"
    )
    for row in rows:
        between = f"{row.low:.3f}-{row.high:.3f}"
        typer.echo(f"{row.name:<52}{row.mean:>7.3f}{between:>16}{row.worst:>8.2f}{row.coverage:>10.3f}{row.time:>7.2f}")
    typer.echo(f"{'without: calibration of the error bars':<52}{'':>31}{rows[0].plain:>10.3f}")
    if out is not None:
        command = (
            f"palpate bench ablation --frames {frames} --numbers {numbers} --kinds '{','.join(names)}' --seed {seed}"
        )
        empty = sum(nothing for _, nothing, _ in found)
        write_text(out, bench.as_markdown(rows, command=command, empty=empty))
        typer.echo(f"wrote           {out}")


@bench_app.command("calibration", cls=Command, epilog=example("bench calibration"))
def bench_calibration(
    frames: Annotated[int, typer.Option(min=20, help="Random contacts.")] = 500,
    method: Annotated[str, typer.Option(help="A method whose error bars have constants.")] = "adaptive",
    contact: Annotated[
        str | None,
        typer.Option(
            help='"line", "area", "area with shear" (the last two also with ", few taxels") or "area, ambiguous"; by default a mixture of the first three.'
        ),
    ] = None,
    sensing: Annotated[str, typer.Option(help="stress, strain or displacement.")] = "stress",
    body: Annotated[str, typer.Option(help="half-space or layers.")] = "half-space",
    across: Annotated[
        int, typer.Option(min=0, help="Contacts across the array's edge, for the error of the load found outside it.")
    ] = 0,
    seed: Annotated[int, typer.Option(help="Seed of the contacts and the noise.")] = 12345,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    write: Annotated[
        Path | None, typer.Option(help="File of constants (constants.json) to put the new ones into.")
    ] = None,
) -> None:
    """Find the constants of the error bars from a random population of contacts."""
    import palpate
    from palpate import bench
    from palpate.uncertainty import AMBIGUOUS, FEW, calibrated_methods

    for name, value, accepted in (
        (
            "contact",
            contact,
            (None, "line", "area", "area with shear", f"area{FEW}", f"area with shear{FEW}", AMBIGUOUS),
        ),
        ("sensing", sensing, ("stress", "strain", "displacement")),
        ("body", body, ("half-space", "layers")),
    ):
        if value not in accepted:
            raise InvalidInput(f"{name} must be one of {', '.join(str(a) for a in accepted if a)}; got {value!r}.")
    if method not in calibrated_methods():
        raise InvalidInput(f"method must be one of {', '.join(calibrated_methods())}; got {method!r}.")
    with Bar("contacts", frames) as step:
        found = bench.calibration(
            frames,
            method=method,
            contact=contact,
            sensing=sensing,
            body=body,
            seed=seed,
            jobs=jobs,
            report=lambda i: step(f"{i}"),
        )
    typer.echo(f"{'case':<52}{'quantity':<21}{'shift':>8}{'scale':>8}{'freedom':>9}")
    for case, quantities in found.items():
        for quantity, (shift, scale, freedom) in quantities.items():
            typer.echo(f"{case!s:<52}{quantity:<21}{shift:>8.3f}{scale:>8.3f}{freedom:>9.2f}")
    outside = {}
    if across:
        with Bar("contacts across the edge", across) as step:
            outside = bench.beyond(found, across, method=method, seed=seed, jobs=jobs, report=lambda i: step(f"{i}"))
        for case, part in outside.items():
            typer.echo(f"{case!s:<52}outside the array, relative {part:.3f}")
    if write is not None:
        bench.write_constants(
            write, found, method=method, frames=frames, seed=seed, version=palpate.__version__, outside=outside
        )
        typer.echo(f"wrote           {write}")


@bench_app.command("trust", cls=Command, epilog=example("bench trust"))
def bench_trust(
    frames: Annotated[int, typer.Option(min=1, help="Random frames of each row.")] = 200,
    rows: Annotated[
        str | None, typer.Option(help="Rows, separated by commas; default: all. A wrong name lists them.")
    ] = None,
    first: Annotated[int, typer.Option(min=0, help="Number of the first frame of each row.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed; frame k of a row is the same whatever else is run.")] = 0,
    limit: Annotated[
        float | None, typer.Option(min=0.1, help="Processor seconds a frame may take; longer ones are left unanswered.")
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Two frames of rows clean, empty and stuck: less than a minute; too few for a rate."
        ),
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    each: Annotated[bool, typer.Option("--each", help="Also list every frame that is wrong without a note.")] = False,
    out: Annotated[Path | None, typer.Option(help="Markdown file for the table.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture of it.")] = None,
    cases: Annotated[Path | None, typer.Option(help="CSV file with every frame.")] = None,
    force: Force = False,
) -> None:
    """Count how often the inversion is wrong without a warning.

    Random sensors meet offsets, pulls, stuck taxels, wrong pads and more, one row for each.
    """
    import csv
    import io

    from palpate.bench import trust

    if quick:
        frames, rows, limit = 2, rows or "clean,empty,stuck", limit or 5.0
    names = tuple(trust.ROWS) if rows is None else tuple(dict.fromkeys(n.strip() for n in rows.split(",")))
    unknown = [n for n in names if n not in trust.ROWS]
    if unknown:
        raise InvalidInput(f"rows must be among {', '.join(trust.ROWS)}; got {', '.join(unknown)}.")
    check_outputs({"--out": out, "--figure": figure, "--cases": cases}, force=force)
    found: list[trust.Verdict] = []
    whole = True
    typer.echo(" | ".join(trust.HEADER))
    try:
        with Bar("frames", frames * len(names)) as step:
            for verdict in trust.trust(frames, rows=names, first=first, seed=seed, limit=limit, jobs=jobs):
                found.append(verdict)
                step(f"{verdict.row} {verdict.index}")
                if each and (verdict.betrays or verdict.broken):
                    typer.echo(trust.sentence(verdict))
                here = [v for v in found if v.row == verdict.row]
                if len(here) == frames:
                    typer.echo(" | ".join(trust.cells(trust.lines(here)[0])))
    except KeyboardInterrupt:
        whole = False
    done = trust.lines(found)
    if not whole:
        unfinished = [line for line in done if line.frames < frames]
        for line in unfinished:
            typer.echo(" | ".join(trust.cells(line)))
        typer.echo("stopped before the end: no files were written", err=True)
        raise typer.Exit(130)
    total = sum(line.frames for line in done)
    typer.echo(f"wrong without a warning: {sum(line.betrays for line in done)} of {total} frames")
    for kind, silent, count in trust.by_sensor(found):
        if silent:
            typer.echo(f"  {kind}: {silent} of {count}")
    if out is not None:
        given = "" if rows is None else f" --rows '{','.join(names)}'"
        given += f" --first {first}" if first else ""
        given += f" --limit {limit:g}" if limit is not None else ""
        command = f"palpate bench trust --frames {frames} --seed {seed}{given}"
        write_text(out, trust.markdown(done, command=command))
    if figure is not None:
        from palpate._plot import plot_trust

        save_figure(plot_trust(done), figure)
    if cases is not None:
        table = io.StringIO()
        writer = csv.writer(table, lineterminator="\n")
        titles, entries = trust.cases(found)
        writer.writerow(titles)
        writer.writerows(entries)
        write_text(cases, table.getvalue())
    written = [str(p) for p in (out, figure, cases) if p is not None]
    if written:
        typer.echo(f"wrote           {', '.join(written)}")
