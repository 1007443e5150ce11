#!/usr/bin/env bash
# bash benchmarks/launch_ray.sh [RECORDING]
# Start a Ray cluster of two nodes on this machine (two raylets), run a sweep of four jobs on it, and
# print where each job ran. Needs pip install 'drivezoo[ray]'. PYTHON=... names the interpreter.
set -euo pipefail
export RAY_TMPDIR="${RAY_TMPDIR:-$(mktemp -d /tmp/ray-XXXX)}" RAY_AUTH_MODE=disabled RAY_USAGE_STATS_ENABLED=0
python="${PYTHON:-python}"
ray="$(dirname "$("$python" -c 'import sys; print(sys.executable)')")/ray"
out="$(mktemp -d)"
nodes=()
trap 'kill "${nodes[@]}" 2>/dev/null; wait; rm -rf "$RAY_TMPDIR"; echo "runs kept in $out"' EXIT

"$ray" start --head --port=6399 --num-cpus=1 --include-dashboard=false --disable-usage-stats --block \
    >/dev/null 2>&1 & nodes+=($!)
until "$ray" health-check --address 127.0.0.1:6399 2>/dev/null; do sleep 1; done
"$ray" start --address=127.0.0.1:6399 --num-cpus=1 --block >/dev/null 2>&1 & nodes+=($!)
"$python" -c "import ray, time; ray.init('127.0.0.1:6399', log_to_driver=False, logging_level='error')
alive = lambda: [n for n in ray.nodes() if n['Alive']]
until = time.monotonic() + 120
while len(alive()) < 2 and time.monotonic() < until: time.sleep(1)
print(len(alive()), 'nodes,', ray.cluster_resources()['CPU'], 'CPUs')
raise SystemExit(len(alive()) < 2)"

"$python" -m zoo -m hydra/launcher=ray hydra.launcher.init.address=127.0.0.1:6399 \
    experiment=tiny41 seed=1,2,3,4 trainer.max_epochs=3 score=none hydra.sweep.dir="$out" \
    ${1:+data.root="$1"}
grep -h '"pid"' "$out"/*/status.json | sort | uniq -c
