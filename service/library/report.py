"""The report of a reconstruction: one HTML page that needs nothing from elsewhere."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from service.library.reconstruction_record import ReconstructionRecord
from service.summary import WeightsUsed

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #26282d; background: #fff; max-width: 62rem; margin: 2rem auto;
  padding: 0 1rem }
h1 { font-size: 1.4rem; margin: 0 } h2 { font-size: 1.05rem; margin: 2rem 0 .5rem }
p.id { color: #6a7078; margin: 0; font-family: ui-monospace, monospace; overflow-wrap: anywhere }
table { border-collapse: collapse } td { padding: .15rem 1.5rem .15rem 0; vertical-align: top;
  overflow-wrap: anywhere } td:first-child { color: #6a7078; white-space: nowrap }
.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(18rem, 1fr)); gap: 1rem }
figure { margin: 0 } img { width: 100%; border-radius: 4px } figcaption { color: #6a7078 }
ul.warnings { background: #fff6e0; border-left: 4px solid #e0a200; padding: .5rem 2rem; margin: 0 }
"""
CAPTIONS: Mapping[str, str] = {
    "depth.png": "Depth, near to far from blue to red",
    "surface.png": "Surface, lit from above",
    "phase/high/left.png": "High phase, left view",
    "phase/high/right.png": "High phase, right view",
    "phase/low/left.png": "Low phase, left view",
    "phase/low/right.png": "Low phase, right view",
}


def embedded(path: Path) -> str:
    """A picture as a data URI, for a page that is to be kept as one file."""
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def report_page(record: ReconstructionRecord, pictures: Mapping[str, str]) -> str:
    """The page. pictures: source (URL or data URI) by artefact name; shown in the order of ``CAPTIONS``."""
    statistics = record.statistics
    shown = [(CAPTIONS[name], pictures[name]) for name in CAPTIONS if name in pictures]
    warnings = record.extra.get("warnings") or []
    others = {name: value for name, value in record.extra.items() if name != "warnings"}
    sections = [
        _warnings(warnings if isinstance(warnings, list) else [warnings]),
        _figures(shown),
        _table(
            "Result",
            {
                "points": f"{statistics.points:,}",
                "valid pixels": f"{statistics.valid_percent:.2f} %",
                "depth, 1 % to 99 %": f"{statistics.z_mm[0]:.2f} to {statistics.z_mm[2]:.2f} mm",
                "median depth": f"{statistics.z_mm[1]:.2f} mm",
                "median confidence": f"{statistics.median_confidence:.3f}",
            },
        ),
        _table(
            "Settings",
            {
                "capture": record.capture,
                "method": record.method,
                **({} if record.weights is None else _weights(record.weights)),
                "matching": record.matching,
                "depth range": f"{record.depth_range[0]:.1f} to {record.depth_range[1]:.1f} mm",
                "image size": f"{record.size[0]} x {record.size[1]} px",
                "calibration (SHA-256)": record.calibration,
                "software": record.software,
                "made": record.created.isoformat(timespec="seconds"),
            },
        ),
        _table("Points by origin", {_words(k): f"{v:.2f} %" for k, v in statistics.origins_percent.items()}),
        _table("Pixels without a point", {_words(k): f"{v:.2f} %" for k, v in statistics.reasons_percent.items()}),
        _table("Time", {_words(k): f"{v:.3f} s" for k, v in record.timings_s.items()}),
        _table("Further facts", {name: _text(value) for name, value in others.items()}),
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Reconstruction {escape(record.id)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f'<h1>Reconstruction</h1>\n<p class="id">{escape(record.id)}</p>\n{"".join(sections)}</body>\n</html>\n'
    )


def _weights(used: WeightsUsed) -> dict[str, str]:
    return {"weights": f"{used.name}, variant {used.variant}", "weights (SHA-256)": used.sha256}


def _warnings(warnings: Iterable[Any]) -> str:
    items = "".join(f"<li>{escape(_text(warning))}</li>" for warning in warnings)
    return f'<h2>Warnings</h2>\n<ul class="warnings">{items}</ul>\n' if items else ""


def _figures(pictures: list[tuple[str, str]]) -> str:
    figures = "".join(
        f'<figure><img src="{escape(source)}" alt="{escape(caption)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>\n"
        for caption, source in pictures
    )
    return f'<h2>Pictures</h2>\n<div class="figures">\n{figures}</div>\n' if figures else ""


def _table(title: str, rows: Mapping[str, str]) -> str:
    cells = "".join(f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>\n" for name, value in rows.items())
    return f"<h2>{escape(title)}</h2>\n<table>\n{cells}</table>\n" if cells else ""


def _words(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
