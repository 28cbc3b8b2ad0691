"""Examples of each command, for its help."""

from __future__ import annotations

__all__ = ["EXAMPLES", "SHORT", "example"]

#: A summary of each command, in the order of the list; each fits on one line of a terminal.
SHORT = {
    "demo": "A first picture and number from a simulated sensor or camera.",
    "reconstruct": "Pressure, shear and forces from a recording, frame by frame.",
    "track": "Follow a recording or a video: contact, slip, forces over time.",
    "live": "Show live in a browser what touches the pad.",
    "tfm": "Traction force microscopy: what a cell does to its gel.",
    "film": "Traction force microscopy of a film, or of many cells.",
    "pillars": "Forces on micropillars from their deflections.",
    "ros": "Run as a node of ROS 2.",
    "convert": "Convert recordings, and tables of other programs.",
    "simulate": "Make the recording of a known contact.",
    "pad": "Show how a pad changes and blurs a touch.",
    "design": "Predict what a sensor resolves before it is built.",
    "sensors": "List known sensors, with their skin.toml.",
    "identify": "Identify the object: ball or flat, patches, stiffness.",
    "weigh": "Find the modulus of a gel from known weights.",
    "calibrate": "Calibrate to newtons: few weights, or a force sensor.",
    "paper": "Reproduce the paper that founded the field.",
    "bench": "Measure the inversion on simulated contacts.",
}

EXAMPLES = {
    "bench ablation": ["palpate bench ablation --quick"],
    "bench accuracy": [
        "palpate bench accuracy --quick",
        "palpate bench accuracy --layouts area --jobs 4 --out accuracy",
    ],
    "bench calibration": ["palpate bench calibration --contact line --frames 100"],
    "bench trust": [
        "palpate bench trust --quick",
        'palpate bench trust --rows "offset,stuck" --frames 50 --out trust.md',
    ],
    "calibrate": [
        'palpate calibrate bench.csv --skin skin.toml --weight "0 g, 0 s to 3 s" --weight "200 g, 5 s to 9 s"',
        'palpate calibrate run-1.csv run-2.csv --skin skin.toml --reference "fz=Fz,fx=Fx" --report calibration.png',
    ],
    "convert": ["palpate convert finger.csv finger.nc", "palpate convert torn.mcap whole.nc --salvage"],
    "demo": ["palpate demo", "palpate demo camera --out gel", "palpate demo taxels --out first-hour"],
    "design": [
        "palpate design design.toml",
        "palpate design design.toml --by pair --plot tradeoffs.pdf --out designs.csv",
    ],
    "film": [
        'palpate film pulled.tif --rest rest.tif --pixel "0.1 um" --youngs-modulus "8 kPa" --poissons-ratio 0.48 --cells cells.tif',
    ],
    "identify": [
        "palpate identify finger.csv --skin skin.toml --baseline 30",
        'palpate identify finger.csv --skin skin.toml --baseline 30 --frame 120 --indentation "1.2 mm"',
    ],
    "live": [
        "palpate live --demo",
        "palpate live finger.csv --skin skin.toml --baseline 30 --friction 0.6",
        "palpate live --udp 9000 --skin skin.toml --record run.mcap",
    ],
    "pad": [
        "palpate pad skin.toml --plot pad.png",
        'palpate pad gelsight_mini --size "25.25 mm x 20.75 mm"',
    ],
    "paper": ["palpate paper --out paper"],
    "pillars": [
        'palpate pillars posts.csv --diameter "2 um +- 3 %" --height "6 um +- 2 %" --modulus "2 MPa +- 10 %" --noise "20 nm"'
    ],
    "reconstruct": [
        "palpate reconstruct finger.csv --skin skin.toml --baseline 30 --out forces.csv --plot-forces forces.png",
        "palpate reconstruct finger.csv --skin skin.toml --baseline 30 --frame 120 --plot touch.png",
    ],
    "ros": ["palpate ros --skin skin.toml --topic /finger/image --friction 0.6"],
    "sensors": ["palpate sensors", "palpate sensors gelsight_mini --out gel.toml"],
    "simulate": ['palpate simulate --skin skin.toml --out known.nc --force "2 N" --friction 0.3 --frames 20'],
    "tfm": [
        'palpate tfm after.tif before.tif --pixel "0.1 um" --youngs-modulus "8 kPa" --poissons-ratio 0.48',
        'palpate tfm u.npy v.npy --unit px --step 8 --pixel "0.1 um" --youngs-modulus "8 kPa" --poissons-ratio 0.48',
        'palpate tfm after.tif before.tif --pixel "0.3 um" --youngs-modulus "8 kPa" --poissons-ratio 0.48 --mask sheet.tif --labels cells.tif --monolayer',
    ],
    "track": [
        "palpate track finger.csv --skin skin.toml --baseline 30 --friction 0.6 --out forces.csv --plot-forces forces.png",
        "palpate track press.mp4 --skin gel.toml --every 10 --picture touch.png",
    ],
    "weigh": ["palpate weigh weight.mp4 --skin gel.toml --force 1.96N"],
}


def example(command: str) -> str:
    """Return the examples of a command for the end of its help; the control character keeps their line breaks."""
    lines = EXAMPLES[command]
    return "\b\n" + "\n".join([f"Example{'s' if len(lines) > 1 else ''}:", *(f"  {line}" for line in lines)])
