"""A worker of a study, as a process: ``python -W error -m tests.tune.study_worker STORAGE TRIALS [MARKER]``.

With a marker it gets stuck in its second trial, having told there who it is, until somebody kills it.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import optuna

from sympol.tune.storage import open_storage


def main(url: str, trials: int, marker: str | None) -> None:
    seen = 0

    def objective(trial: optuna.Trial) -> float:
        nonlocal seen
        seen += 1
        x = trial.suggest_float("x", -1.0, 1.0)
        if marker is not None and seen == 2:
            Path(marker).write_text(f"{os.getpid()} {trial.number}")
            time.sleep(600)
        time.sleep(0.5)
        return x * x

    storage = open_storage(url, heartbeat=1)
    study = optuna.create_study(storage=storage, study_name="s", load_if_exists=True)
    enough = optuna.study.MaxTrialsCallback(trials, states=(optuna.trial.TrialState.COMPLETE,))
    study.optimize(objective, callbacks=[enough])


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else None)
