#!/usr/bin/env bash
# sudo bash benchmarks/launch_slurm.sh [RECORDING]
# Start Slurm's controller and node on this machine from Debian's packages (apt install slurmctld
# slurmd slurm-client munge), run a sweep of four jobs on it, and print Slurm's states of the jobs.
# Needs pip install 'drivezoo[slurm]'. PYTHON=... names the interpreter. It ends its daemons.
set -euo pipefail
python="${PYTHON:-python}"
place="$(mktemp -d /tmp/slurm-XXXX)" out="$(mktemp -d)"
chmod 755 "$place"
started=()
finish() {
    scancel --user="$(id -un)" 2>/dev/null || true
    for process in "${started[@]}"; do kill "$process" 2>/dev/null || true; done
    echo "daemons' logs in $place, the sweep in $out"
}
trap finish EXIT

mkdir -p /run/munge && chown munge: /run/munge
[ -s /etc/munge/munge.key ] || { dd if=/dev/urandom of=/etc/munge/munge.key bs=1 count=1024 status=none
    chown munge: /etc/munge/munge.key; chmod 400 /etc/munge/munge.key; }
if ! munge -n >/dev/null 2>&1; then
    runuser -u munge -- munged --foreground >"$place/munged.log" 2>&1 &
    started+=($!)
fi

host="$(hostname -s)"
export SLURM_CONF="$place/slurm.conf"
cat > "$SLURM_CONF" <<CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
SlurmctldPort=16817
SlurmdPort=16818
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MpiDefault=none
AccountingStorageType=accounting_storage/none
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
mkdir -p "$place/state" "$place/spool"
sleep 1
slurmctld -D >"$place/slurmctld.out" 2>&1 & started+=($!)
slurmd -D -N "$host" >"$place/slurmd.out" 2>&1 & started+=($!)
for _ in $(seq 30); do sinfo -h -o %T 2>/dev/null | grep -q idle && break; sleep 1; done
sinfo

"$python" -m zoo -m hydra/launcher=slurm hydra.launcher.partition=all \
    hydra.launcher.cpus_per_task=1 hydra.launcher.mem_gb=1 hydra.launcher.timeout_min=10 \
    experiment=tiny41 seed=1,2,3,4 trainer.max_epochs=3 score=none hydra.sweep.dir="$out" \
    ${1:+data.root="$1"} 2>&1 | grep -v -e sacct -e "accounting storage" # this Slurm keeps no accounts
for _ in $(seq 60); do [ -z "$(squeue -h)" ] && break; sleep 1; done # Slurm takes a while to clean up
scontrol show job --oneliner | sed -E 's/.*(ArrayJobId=[^ ]*).*(ArrayTaskId=[^ ]*).*(JobState=[^ ]*).*(RunTime=[^ ]*).* (NodeList=[^ ]*).*/\1 \2 \3 \4 \5/'
