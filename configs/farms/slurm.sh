#!/bin/bash
# Chunks of a job on a SLURM cluster, one task of an array each. In the folder of the job's file, on a disk that all nodes share:
#
#   last=$(rsvideo chunks JOB.yaml | python3 -c 'import json, sys; print(len(json.load(sys.stdin)) - 1)')
#   array=$(sbatch --parsable --array="0-$last" slurm.sh JOB.yaml)
#   sbatch --dependency="afterany:$array" --wrap 'rsvideo finish JOB.yaml'
#
# A task that failed is named by rsvideo finish; sbatch --array=NUMBERS runs it again.
#SBATCH --job-name=rsvideo
#SBATCH --cpus-per-task=4
#SBATCH --mem=4G
#SBATCH --requeue
set -euo pipefail
exec rsvideo work "$1" --chunks "${SLURM_ARRAY_TASK_ID:?sbatch --array=0-N states it}"
