"""What a person reads in the terminal: the summary as a table on stdout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TextIO

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from yawid.channels.vehicle import TYPE_NAMES
from yawid.results.judge_estimate import LEAST_SIMULATION_PCT
from yawid.sinks.answers import answering, percent

WIDTH = 80
MOST_BOOTS = 4
"""Further boots are left to --json."""


def print_summary(summary: Mapping[str, Any], stream: TextIO) -> None:
    """Print the summary of one run: the verdict first, then how sure, then where it comes from."""
    console = Console(file=stream, highlight=False, width=None if stream.isatty() else WIDTH)
    console.print(Text(str(summary["log"]), style="bold"))
    print_verdict(console, summary["verdict"])
    if summary.get("estimates"):
        console.print(_estimates_table(summary))
    for line in origin(summary):
        console.print(Text(line))
    for kind, path in summary.get("files", {}).items():
        # A path is for copying: it must not be wrapped.
        console.print(Text(f"{kind:>8}  {path}"), soft_wrap=True)


def print_verdict(console: Console, verdict: Mapping[str, Any]) -> None:
    """Print whether the answer is usable, and every reason."""
    word = Text("usable", "bold green") if verdict["usable"] else Text("NOT USABLE", "bold red")
    console.print(Text("verdict  ") + word)
    for reason in verdict["reasons"]:
        style = "red" if reason["weight"] == "fatal" else "yellow"
        line = Text(f"{reason['id']}: ", style) + Text(reason["text"], "default")
        console.print(Padding(line, (0, 0, 0, 2), expand=False))


def _estimates_table(summary: Mapping[str, Any]) -> Table:
    estimates = summary["estimates"]
    answers = answering(summary) if summary["verdict"]["usable"] else None
    table = Table(box=None, pad_edge=False)
    table.add_column("± is one sigma")
    for method in estimates:
        marked = " answers" if method == answers and len(estimates) > 1 else ""
        table.add_column(method.upper() + marked, justify="right")
    rows: dict[str, list[str]] = {}
    for estimate in estimates.values():
        for name, text in _estimate_rows(estimate).items():
            rows.setdefault(name, []).append(text)
    for name, texts in rows.items():
        table.add_row(name, *texts)
    return table


def _estimate_rows(estimate: Mapping[str, Any]) -> dict[str, str]:
    mode, fit = estimate.get("dutch_roll", {}), estimate["fit"]
    orders = estimate["orders"]
    return {
        "Dutch roll wn, rad/s": _with_sigma(mode, "wn_rad_s", "wn_std"),
        "Dutch roll zeta": _with_sigma(mode, "zeta", "zeta_std"),
        "fit one step, %": _percent(fit, "one_step_pct"),
        "fit simulated, %": _percent(fit, "simulation_pct"),
        "fit on held-back data, %": _percent(fit, "simulation_held_back_pct"),
        "samples learnt from / others": f"{estimate['updates']} / {estimate['held']}",
        "na,nb,nc,nk at rate": ",".join(str(orders[o]) for o in ("na", "nb", "nc", "nk"))
        + f" at {1.0 / estimate['sample_time_s']:.3g} Hz",
    }


def _with_sigma(values: Mapping[str, float], name: str, sigma: str) -> str:
    if name not in values:
        return "none"
    spread = f" ± {values[sigma]:.2g}" if sigma in values else ""
    return f"{values[name]:.4g}{spread}"


def _number(values: Mapping[str, float], name: str, spec: str) -> str:
    return format(values[name], spec) if name in values else "-"


def _percent(values: Mapping[str, float], name: str) -> str:
    return percent(values[name]) if name in values else "-"


def origin(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each channel, where it comes from, and one for the link."""
    for name, channel in summary["channels"].items():
        rate = f" at {channel['rate_hz']:.3g} Hz" if "rate_hz" in channel else ""
        how = f" ({channel['how']})" if "how" in channel else ""
        yield f"{name:>8}  {channel['source']}{rate}{how}"
    link = summary["link"]
    leap_s, names = link.get("clock_leap_s"), [n for n in link if n != "clock_leap_s"]
    counts = ", ".join(
        f"{link[n]} {n.replace('_', ' ')}" for n in names if link[n] or n == "frames"
    )
    leapt = f"; the vehicle's clock leapt by {leap_s:.0f} s" if leap_s else ""
    if counts or leapt:  # of a recovered run nobody knows
        yield f"    link  {counts}{leapt}"
    if "vehicles" in summary:
        yield f"vehicles  {_vehicles(summary)}"
    if "boots" in summary:
        each = [f"{b['boot']}: {b['from']:.0f} to {b['to']:.0f} s" for b in summary["boots"]]
        yield f"   boots  {', '.join(each[:MOST_BOOTS])}{', ...' * (len(each) > MOST_BOOTS)}"


def _vehicles(summary: Mapping[str, Any]) -> str:
    """Name every vehicle in the log, and which of them is answered."""
    locked = summary.get("vehicle", {})
    answered = locked.get("sysid"), locked.get("compid")
    named = [
        f"{each['sysid']}/{each['compid']} {TYPE_NAMES.get(each['type'], 'unknown')}"
        + (" (answered)" if (each["sysid"], each["compid"]) == answered else "")
        for each in summary["vehicles"]
    ]
    return f"{', '.join(named)}: choose another by --sysid"


def print_orders(report: Mapping[str, Any], stream: TextIO, most: int = 12) -> None:
    """Print the best structures of a log as a table, and the one to use."""
    console = Console(file=stream, highlight=False, width=None if stream.isatty() else WIDTH)
    console.print(Text(str(report["log"]), style="bold"))
    table = Table(box=None, pad_edge=False)
    for heading in ("na,nb,nc,nk", "simulated %", "BIC", "AIC", "white p", "wn", "zeta", "ns"):
        table.add_column(heading, justify="right")
    for candidate in report["candidates"][:most]:
        mode = candidate.get("dutch_roll", {})
        table.add_row(
            ",".join(str(candidate[name]) for name in ("na", "nb", "nc", "nk")),
            _percent(candidate, "simulation_pct"),
            _number(candidate, "bic", ".0f"),
            _number(candidate, "aic", ".0f"),
            _number(candidate, "whiteness_p", ".2g"),
            _number(mode, "wn_rad_s", ".3f"),
            _number(mode, "zeta", ".3f"),
            _number(candidate, "update_ns", ".0f"),
        )
    console.print(table)
    chosen = ",".join(str(value) for value in report["recommended"].values())
    console.print(Text(f"recommended  --orders {chosen}", style="bold"))
    best = max((c.get("simulation_pct", 0.0) for c in report["candidates"]), default=0.0)
    if best < LEAST_SIMULATION_PCT:
        text = f"no structure tells {LEAST_SIMULATION_PCT:.0f} % of the yaw rate from the inputs: "
        console.print(Text(text + "see yawid inspect for what the log lacks", style="yellow"))
