"""The certificate for a reader: a table on the terminal, a page in Markdown or HTML."""

from __future__ import annotations

import html

from rich.table import Table

from eampc.certificate import NOT_PROVED, PARTS, Certificate
from eampc.law import Law

_TITLES = {
    "optimality": "every region is optimal",
    "coverage": "the regions tile the box",
    "continuity": "continuous across facets",
    "evaluator": "the evaluator gives this law",
    "cost": "operations are bounded",
    "tightening": "tightening as assumed",
}
_HOW = {
    "optimality": "Each active set is solved again in extended precision; the residuals of the "
    "Karush-Kuhn-Tucker conditions are bounded on the whole box by the sum of their coefficients. "
    "H is positive definite, so the conditions are sufficient and the solution is the only one.",
    "coverage": "Each inner facet is met from the other side by exactly one region, or by several "
    "that share it: compared by coefficients, through dependent rows and flat regions where there "
    "are any. So every generic point is held by equally many regions; the generic points tried are "
    "held by one.",
    "continuity": "The laws on both sides of a facet differ there by no more than this.",
    "evaluator": "Every region is pushed down the evaluator by linear programs; in each leaf that "
    "it reaches, no point exists at which the clipped value differs from the clipped law by more "
    "than the bound. No sampling.",
    "cost": "Counted anew from the tables.",
    "tightening": "Computed again from the stated assumptions, by other formulae, and found in the "
    "rows of the problem.",
}


def findings(certificate: Certificate) -> dict[str, str]:
    """Part → its figures in words."""
    f = certificate.figures
    outside = ""
    if f["sliver_cells"]:
        outside = (
            f", but in {f['sliver_cells']} slivers (largest ball {f['sliver_radius']:.1e}) at most "
            f"{f['sliver_error']:.0e}"
        )
    volume = f", volumes add up to {f['volume']:.12g} of the box" if "volume" in f else ""
    return {
        "optimality": f"{f['regions']} regions, residuals {f['stationarity_residual']:.1e} and "
        f"{f['primal_residual']:.1e} of their terms, eigenvalues of H "
        f"{f['smallest_eigenvalue']:.3g} .. {f['largest_eigenvalue']:.3g}",
        "coverage": f"{f['facets']} facets, {f['facets_matched']} matched, {f['facets_walked']} "
        f"through dependent rows or {f['gaps']} gaps (largest ball {f['largest_gap']:.1e}), "
        f"{f['facets_uncovered']} uncovered{volume}",
        "continuity": f"output jumps {f['output_jump']:.1e} of its range at most",
        "evaluator": f"{f['cells']} cells, error at most {f['law_error']:.0e} of the range{outside}"
        f"; {f['edge_error']:.0e} more within 2e-11 of a hyperplane",
        "cost": f"at most {f['worst_operations']} operations, {f['depth']} nodes",
        "tightening": f"{f['tightening_kind']}, {f['tightened_rows']} rows, differs by "
        f"{f['tightening_difference']:.1e}",
    }


def invariant_words(certificate: Certificate) -> str:
    """The closed loop of the nominal model in one sentence."""
    f = certificate.figures
    if not f["invariant_facets"]:
        return str(f["invariant_statement"])
    return (
        f"{f['invariant_facets']} facets after {f['invariant_steps']} steps, spectral radius "
        f"{f['spectral_radius']:.4f}; holds {100 * f['invariant_box_scaling']:.2g} % of the box "
        f"scaled about its centre, about {100 * f['invariant_volume_estimate']:.2g} % of its "
        f"volume (estimated from {f['invariant_samples']} points): {f['invariant_statement']}"
    )


def certificate_table(certificate: Certificate, name: str) -> Table:
    """A row for each proof."""
    table = Table(title=name, title_justify="left")
    table.add_column("proof")
    table.add_column("verdict")
    table.add_column("figures")
    words = findings(certificate)
    for part in PARTS:
        verdict = str(certificate.figures[part])
        style = "red" if verdict == NOT_PROVED else "green"
        table.add_row(_TITLES[part], f"[{style}]{verdict}[/{style}]", words[part])
    table.add_row(
        "closed loop", "", f"|u| within its bounds always; {invariant_words(certificate)}"
    )
    return table


def markdown_report(certificate: Certificate, law: Law) -> str:
    """The whole certificate as a page."""
    rig = law.payload["rig"]
    verdict = "**proved**" if certificate.proved else f"**not proved**: {certificate.failure}"
    words = findings(certificate)
    lines = [
        f"# Certificate of the law {_title(rig)}",
        "",
        f"This law is {verdict}. Inputs sha256 {rig['inputs_sha256']}, designed by eampc "
        f"{rig['eampc_version']}, proved by eampc {certificate.figures['eampc_version']}.",
        "",
        "Parameters are scaled so that the box is ±1 in each, outputs so that their range is 1.",
        "",
    ]
    for part in PARTS:
        lines += [
            f"## {_TITLES[part].capitalize()}: {certificate.figures[part]}",
            "",
            _HOW[part],
            "",
            f"Found: {words[part]}.",
            "",
        ]
    lines += [
        "## Closed loop of the nominal model",
        "",
        "The control is clipped to its bounds, so they hold always. Largest robust "
        f"output-admissible set of the unsaturated loop: {invariant_words(certificate)}.",
        "",
        "## All figures",
        "",
        "| figure | value |",
        "|---|---|",
        *(f"| {key} | {_number(value)} |" for key, value in certificate.figures.items()),
        "",
    ]
    return "\n".join(lines)


def html_report(certificate: Certificate, law: Law) -> str:
    """The same page in HTML."""
    body, rows = [], False
    for line in markdown_report(certificate, law).splitlines():
        text = html.escape(line).replace("**", "")
        if line.startswith("|"):
            if set(line) <= set("|-"):
                continue
            cells = "".join(f"<td>{cell.strip()}</td>" for cell in text.strip("|").split("|"))
            body.append(("" if rows else "<table>") + f"<tr>{cells}</tr>")
            rows = True
            continue
        if rows:
            body.append("</table>")
            rows = False
        level = len(line) - len(line.lstrip("#"))
        if level:
            body.append(f"<h{level}>{text[level + 1 :]}</h{level}>")
        elif line:
            body.append(f"<p>{text}</p>")
    if rows:
        body.append("</table>")
    style = (
        "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
        "td{border-bottom:1px solid #ccc;padding:.2em 1em .2em 0}"
    )
    title = html.escape(f"Certificate of the law {_title(law.payload['rig'])}")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{style}</style></head>\n<body>\n" + "\n".join(body) + "\n</body></html>\n"
    )


def _title(rig: dict[str, str]) -> str:
    return rig["name"] + (f", variant {rig['variant']}" if rig["variant"] else "")


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
