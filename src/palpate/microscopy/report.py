"""Write a report as one HTML file: numbers, pictures, assumptions."""

from __future__ import annotations

import base64
import csv
import html
import io
from pathlib import Path
from typing import Any

from palpate.microscopy.figures import ShownCell, plot_error, plot_field, plot_traction
from palpate.recordings.files import atomically

__all__ = ["write_report", "write_table"]

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1c1c1e;background:#fff;max-width:62rem;margin:2rem auto;padding:0 1rem}
h1{font-size:1.5rem}h2{font-size:1.1rem;margin-top:2rem}table{border-collapse:collapse;width:100%}
th,td{text-align:left;padding:.3rem .7rem .3rem 0;border-bottom:1px solid #ddd;vertical-align:top}td.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
td.w{color:#555;font-size:.88rem}figure{margin:1rem 0}img{max-width:100%}figcaption{color:#555;font-size:.9rem}li{margin:.3rem 0}
.off{color:#8e1b3a;font-weight:600}code{background:#f3f3f5;padding:.1rem .3rem;overflow-wrap:anywhere}.two{display:grid;grid-template-columns:repeat(auto-fit,minmax(20rem,1fr));gap:1rem}
"""


def _picture(figure: Any, caption: str) -> str:
    held = io.BytesIO()
    figure.savefig(held, format="png", dpi=130)
    data = base64.b64encode(held.getvalue()).decode("ascii")
    return f'<figure><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}"><figcaption>{html.escape(caption)}</figcaption></figure>'


def _rows(forces: ShownCell) -> str:
    out = []
    for q in forces.quantities.values():
        value, std, unit = q.scaled()
        should = ""
        if q.expected is not None:
            far = abs(q.value - q.expected) / q.std if q.std > 0 else 0.0
            should = f"{q.expected:g}" + (
                f' <span class="off">{far:.1f} standard deviations off</span>' if far > 3 else ""
            )
        plus = f" &plusmn; {std}" if q.std > 0 else ""
        out.append(
            f'<tr><td>{html.escape(q.label)}</td><td class="n">{value}{plus} {html.escape(unit.replace("^2", "²"))}</td><td>{should}</td>'
            f'<td class="w">{html.escape(q.why)}</td></tr>'
        )
    return "\n".join(out)


def write_report(forces: ShownCell, path: str | Path, *, title: str = "", source: str = "", command: str = "") -> None:
    """See `CellForces.write_report`."""
    field = forces.field
    rows, columns = field.shape
    name = title or "Traction of a cell"
    drift = ""
    if field.drift is not None:
        drift = f"<li>drift of {field.drift[0] * 1e9:.1f} nm along x and {field.drift[1] * 1e9:.1f} nm along y ({field.drift[0] / field.pixel:.2f} and {field.drift[1] / field.pixel:.2f} px) was taken out</li>"
    large, small, angle = forces.principal
    facts = [
        f"<li>{columns} x {rows} vectors, one every {field.step:.3g} px = {field.pitch * 1e6:.3g} µm; {100 * field.valid.mean():.1f} % of them are there</li>",
        drift,
        f"<li>gel: {html.escape(_gel(forces.pad))}</li>",
        f"<li>noise of the displacements, as learned or given: {_noise(forces)}</li>",
        f"<li>principal contractile moments {large:.3g} and {small:.3g} N m, the larger at {angle % 180:.0f}° from x towards y (down)</li>",
    ]
    text = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1"><title>{html.escape(name)}</title><style>{_STYLE}</style></head><body>
<h1>{html.escape(name)}</h1>
<p>{html.escape(source)}</p>
{_picture(plot_traction(forces), "Traction on the gel, with arrows where it is large" + ("; dashed: the mask" if forces.masked else ""))}
<h2>Numbers</h2>
<table><tr><th></th><th>value &plusmn; standard deviation</th><th>should be</th><th></th></tr>
{_rows(forces)}
</table>
<h2>What it is made of</h2>
<ul>{"".join(facts)}</ul>
<div class="two">{_picture(plot_field(field), "Displacements")}{_picture(plot_error(forces), "Standard deviation of the traction")}</div>
<h2>What was assumed, and what to look at</h2>
<ul>{"".join(f"<li>{html.escape(note)}</li>" for note in forces.notes)}</ul>
<h2>How it was made</h2>
<p>{f"<code>{html.escape(command)}</code>" if command else ""} {_version()}</p>
</body></html>
"""
    atomically(path, lambda at: _write(at, text))


def _gel(pad: Any) -> str:
    layers = getattr(pad, "layers", None)
    if layers is None:
        modulus, ratio = getattr(pad, "youngs_modulus", None), getattr(pad, "poissons_ratio", None)
        return (
            f"half-space, Young's modulus {modulus:g} Pa, Poisson's ratio {ratio:g}"
            if modulus is not None
            else type(pad).__name__
        )
    return "on a rigid base: " + "; ".join(
        f"{1e6 * one.thickness:g} µm of Young's modulus {one.youngs_modulus:g} Pa, Poisson's ratio {one.poissons_ratio:g}"
        for one in layers
    )


def _noise(forces: ShownCell) -> str:
    noise = forces.touch.noise_std
    return "not known" if noise is None else ", ".join(f"{1e9 * float(n):.3g} nm" for n in noise.ravel())


def _version() -> str:
    import palpate

    return f"palpate {palpate.__version__}"


def _write(at: str, text: str) -> None:
    Path(at).write_text(text, encoding="utf-8")


def write_table(forces: ShownCell, path: str | Path) -> None:
    """See `CellForces.write_table`."""
    held = io.StringIO()
    writer = csv.writer(held, lineterminator="\n")
    writer.writerow(["quantity", "value", "std", "low_95", "high_95", "unit", "should_be"])
    for key, q in forces.quantities.items():
        low, high = q.interval
        writer.writerow(
            [
                key,
                f"{q.value:.8g}",
                f"{q.std:.4g}",
                f"{low:.8g}",
                f"{high:.8g}",
                q.unit,
                "" if q.expected is None else f"{q.expected:g}",
            ]
        )
    atomically(path, lambda at: _write(at, held.getvalue()))
