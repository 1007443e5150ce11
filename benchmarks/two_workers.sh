#!/usr/bin/env bash
# bash benchmarks/two_workers.sh [RECORDING]
# Run two processes on one Optuna study in SQLite, with trials pruned by how they drive; then print
# the study. Needs pip install 'drivezoo[optuna]'. PYTHON=... names the interpreter.
set -euo pipefail
python="${PYTHON:-python}"
out="$(mktemp -d)"
study="sqlite:///$out/study.db"
work() {
    "$python" -m zoo -m hydra/sweeper=optuna hydra.sweeper.n_trials=8 hydra.sweeper.storage="$study" \
        hydra.sweeper.startup_trials=3 experiment=tiny41 trainer.max_epochs=6 \
        callbacks=closed_loop callbacks.early_stopping=null callbacks.closed_loop.share=null \
        callbacks.closed_loop.starts=2 callbacks.closed_loop.metres=60 \
        'optim.lr=tag(log,interval(1e-4,1e-1))' 'data.offset=interval(0.0,0.5)' score.laps=0.2 \
        hydra.sweep.dir="$out/$1" ${2:+data.root="$2"} >"$out/$1.log" 2>&1
}
work one "${1:-}" & first=$!
work two "${1:-}"
wait "$first"
grep -h "^study" "$out"/*.log
"$python" - "$study" <<'PY'
import sys, optuna
study = optuna.load_study(study_name="drivezoo", storage=sys.argv[1])
for trial in study.trials:
    worker = trial.user_attrs["folder"].rpartition("/")[2]
    epochs = len(trial.intermediate_values)
    print(f"{trial.number:>2} {worker} {trial.state.name:<8} {epochs:>2} epochs", trial.value, trial.params)
PY
echo "runs kept in $out"
