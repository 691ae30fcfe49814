"""A Monte-Carlo campaign on a Dask cluster: chunks of trial indices, columns back."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eampc import _core
from eampc.errors import RunFailed, UserError
from eampc.verification import CLUSTER_CHUNK, CampaignSettings, Columns, Progress

if TYPE_CHECKING:
    from distributed import Client

CONNECT_TIMEOUT_S = 10.0


def run_on_cluster(
    scheduler: str,
    law: bytes,
    settings: CampaignSettings,
    first: int,
    trials: int,
    threads: int,
    progress: Progress | None,
) -> tuple[Columns, float]:
    """Columns of the trials in order, and processor seconds of all workers together.

    Each worker uses `threads` threads per chunk (0: one, Dask itself starts several chunks).
    Raises UserError if `distributed` is missing or the scheduler does not answer, RunFailed if a
    worker fails or runs another build.
    """
    with _connected(scheduler) as client:
        shared = client.scatter((law, settings), broadcast=True)
        sizes = {
            begin: min(CLUSTER_CHUNK, first + trials - begin)
            for begin in range(first, first + trials, CLUSTER_CHUNK)
        }
        futures = {
            client.submit(run_chunk, shared, begin, count, threads or 1, pure=False): begin
            for begin, count in sizes.items()
        }
        return _gathered(futures, sizes, progress)


def run_chunk(
    shared: tuple[bytes, CampaignSettings], begin: int, count: int, threads: int
) -> tuple[str, Columns, float]:
    """What one worker does: (build, columns, processor seconds)."""
    law, settings = shared
    checked = _core.law_from_bytes(law, "the campaign's law")
    return (
        build_digest(),
        *_core.run_campaign(checked, settings.compiled(), begin, count, threads),
    )


def build_digest() -> str:
    """Of the compiled module: equal builds give equal numbers."""
    return hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()[:12]


def _connected(scheduler: str) -> Client:
    try:
        from distributed import Client
    except ModuleNotFoundError:
        raise UserError(
            "--scheduler needs the package distributed; install it: pip install 'eampc[cluster]'"
        ) from None
    try:
        return Client(scheduler, timeout=CONNECT_TIMEOUT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise UserError(
            f"no Dask scheduler answers at {scheduler} ({type(error).__name__}); start one with "
            "dask scheduler, and workers with dask worker"
        ) from None


def _gathered(
    futures: dict[Any, int], sizes: dict[int, int], progress: Progress | None
) -> tuple[Columns, float]:
    from distributed import as_completed

    parts: dict[int, Columns] = {}
    core_seconds, done = 0.0, 0
    try:
        for future in as_completed(futures):
            begin = futures[future]
            build, parts[begin], seconds = _result_of(future)
            if build != build_digest():
                raise RunFailed(
                    f"a worker of the cluster runs another build of eampc ({build}, here "
                    f"{build_digest()}); install the same on all machines"
                )
            core_seconds += seconds
            done += sizes[begin]
            if progress is not None:
                progress(done)
    finally:
        for future in futures:
            future.cancel()
    ordered = [parts[begin] for begin in sorted(parts)]
    names = ordered[0] if ordered else ()
    return {name: np.concatenate([part[name] for part in ordered]) for name in names}, core_seconds


def _result_of(future: Any) -> Any:
    try:
        return future.result()
    except Exception as error:
        raise RunFailed(
            f"a worker of the cluster failed ({type(error).__name__}: {error}); see its log"
        ) from error
