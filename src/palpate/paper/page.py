"""The reproduction on one page, to read and to print, with every figure and table beside it as a file."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from pathlib import Path

from palpate.errors import InvalidInput
from palpate.paper.beyond import our_figures
from palpate.paper.cases import DEPTH, EPS, FRICTION, HALF_WIDTH, LOAD, PITCH, SENSORS
from palpate.paper.pictures import PaperFigure, figures
from palpate.paper.tables import Results, results, to_csv, to_html
from palpate.recordings.files import atomically

__all__ = ["report"]


def report(folder: str | Path, *, progress: Callable[[str], None] | None = None) -> Path:
    """Write ``report.html`` (self-contained), every figure as PNG and CSV, and the tables as CSV; returns the report's path."""
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InvalidInput(f"{target} is a file; give a folder.")
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"{target}: cannot make the folder ({error.strerror}).") from error
    say = progress or (lambda _: None)
    say("tables")
    found = results()
    for name, rows in found.tables().items():
        _write(target / f"{name}.csv", to_csv(rows).encode())

    def draw(several: Sequence[PaperFigure]) -> list[str]:
        parts = []
        for figure in several:
            say(figure.label.lower())
            if figure.panels:
                _write(target / f"{figure.name}.csv", figure.table().encode())
            parts.append(_figure(figure, target))
        return parts

    own = our_figures(found.noise, found.truncation)
    page = _page(draw(figures()), draw(own), found)
    path = target / "report.html"
    _write(path, page.encode())
    return path


def _write(path: Path, content: bytes) -> None:
    def write(name: str) -> None:
        with open(name, "wb") as file:
            file.write(content)

    atomically(path, write)


def _figure(figure: PaperFigure, folder: Path) -> str:
    buffer = io.BytesIO()
    figure.draw().savefig(buffer, dpi=220, format="png")
    _write(folder / f"{figure.name}.png", buffer.getvalue())
    picture = base64.b64encode(buffer.getvalue()).decode()
    caption = html.escape(figure.caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{picture}">'
        f"<figcaption><b>{figure.label}.</b> {caption}.</figcaption></figure>"
    )


def _page(drawn: Sequence[str], own: Sequence[str], found: Results) -> str:
    formulas = to_html(found.text("formulas", code=("<code>", "</code>")), raw=["computed by"])
    text = {
        name: to_html(found.text(name))
        for name in ("errors", "friction", "claims", "profile_readings", "friction_readings", "speed")
    }
    return f"""{_HEAD}
<h1>The founding paper, figure by figure</h1>
<p>R. Yang&rsquo;s and P. S. Krishnaprasad&rsquo;s group (University of Maryland, late 1980s) recovered the pressure of a line contact
on an elastic half-space from the normal stress or strain at depth, by dividing Fourier transforms. Depth {DEPTH}, sampling {PITCH},
{SENSORS} sensors unless said, E&nbsp;=&nbsp;1, &nu;&nbsp;=&nbsp;0.5. Figures carry the paper&rsquo;s numbers and axes, and captions in our
words; y is the distance along the surface, z the depth. The paper states neither the half-width a, nor the load P, nor the amount
&epsilon; that it adds to a, nor the friction coefficient: a&nbsp;=&nbsp;{HALF_WIDTH}, P&nbsp;=&nbsp;{LOAD}, &epsilon;&nbsp;=&nbsp;{EPS} and
&mu;&nbsp;=&nbsp;{FRICTION} are fitted (see tables 5 and 6).</p>
<section class="figures">{"".join(drawn)}</section>
<h2>Errors</h2>
<div class="wide"><p class="title"><b>Table 1.</b> Mean absolute error (equation 26) without friction: printed in the paper, by division in double
precision, in single precision with a fast and with a slow transform, with readings kept to seven decimals, and by the linear system that
made the data. An error of strain is wrap-around and comes out to three digits; one of stress is rounding, and only its size can be
compared.</p>{text["errors"]}</div>
<div class="wide"><p class="title"><b>Table 2.</b> The same with constant friction, from one channel; an exponent that cannot be read is marked ?. &ldquo;M
found&rdquo; is the paper&rsquo;s algorithm, with the half-width from the even part; &ldquo;one too wide&rdquo; the same with M = 8 for 7. The printed
errors from strain are near the latter, those from stress near the former with rounded readings. Ours: the algorithm on the linear system,
and <code>method="constant_friction"</code>, which is told neither the middle nor the sampling of the contact (its shear keeps the law of friction,
the paper&rsquo;s samples hold 15/14 of it).</p>{text["friction"]}</div>
<div class="wide"><p class="title"><b>Table 3.</b> What the paper says, and what we find.</p>{text["claims"]}</div>
<div class="wide"><p class="title"><b>Table 4.</b> Every equation, and what computes it.</p>{formulas}</div>
<h2>Beyond the paper</h2>
<p>What follows is ours.</p>
<section class="ours">{"".join(own)}</section>
<div class="wide"><p class="title"><b>Table 5.</b> Which a, P and &epsilon; the paper used: those that give both errors from strain without friction. The axes of
its figures leave the cylinder&rsquo;s peak between 0.10 and 0.13, the rectangle&rsquo;s between 0.3 and 0.4; one line keeps to
them.</p>{text["profile_readings"]}</div>
<div class="wide"><p class="title"><b>Table 6.</b> Readings of the friction algorithm: by how many samples M is wrong in the case of strain, and whether the
contact counts as 2M periods or 2M + 1 samples. &mu; is what gives the printed tangential error, 1.45e-3; the printed vertical one is
1.15e-3. With M right no &mu; gives both.</p>{text["friction_readings"]}</div>
<div class="wide"><p class="title"><b>Table 7.</b> Speed on this machine, seconds: first frame (with preparation) and each one after.</p>{text["speed"]}</div>
</main></body></html>
"""


_HEAD = """<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>palpate: the founding paper, figure by figure</title><style>
@page { size: A4; margin: 15mm; }
body { font: 10.5pt/1.4 "Source Serif 4", "Noto Serif", Georgia, "Times New Roman", serif; color: #111; background: white; margin: 0; }
main { max-width: 180mm; margin: auto; padding: 8mm 4mm; }
h1 { font-size: 18pt; margin: 0 0 .5em; } h2 { font-size: 13pt; margin: 1.2em 0 .4em; break-after: avoid; }
p { margin: .4em 0; text-align: justify; hyphens: auto; }
.figures { display: grid; grid-template-columns: 1fr 1fr; gap: 3mm 7mm; align-items: start; margin-top: 4mm; }
.ours { columns: 2; column-gap: 7mm; margin-top: 4mm; } .ours figure { margin-bottom: 4mm; }
figure { margin: 0; break-inside: avoid; }
img { width: 100%; display: block; }
figcaption { font-size: 8.5pt; line-height: 1.3; margin-top: 1mm; }
.wide { margin: 4mm 0; } .title { font-size: 9pt; line-height: 1.3; break-after: avoid; }
table { border-collapse: collapse; font-size: 8.5pt; line-height: 1.3; width: 100%; font-variant-numeric: tabular-nums; }
thead { border-top: 1pt solid; border-bottom: .5pt solid; } tbody { border-bottom: 1pt solid; }
th, td { padding: .5mm 1.5mm; text-align: left; vertical-align: top; } th { vertical-align: bottom; } tr { break-inside: avoid; }
code { font: 7.5pt ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
@media print { main { padding: 0; max-width: none; } }
@media (max-width: 150mm) { .figures { grid-template-columns: 1fr; } .ours { columns: 1; } .wide { overflow-x: auto; } }
</style></head><body><main>"""
