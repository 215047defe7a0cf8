#!/usr/bin/env bash
# @TASKS@ tasks for Slurm: `bash THIS [OPTIONS OF SBATCH]`. The first job computes what the tasks have in common and leaves it in the cache;
# the last one makes the contact sheet, even if tasks fail. The output of jobs is in the folder of logs.
set -euo pipefail
cd @FOLDER@
command=(@COMMAND@)
logs=@LOGS@
options=(@RESOURCES@ "$@")
mkdir -p "$logs"

# submit AFTER ARRAY ARGUMENTS LOG: submits the command with further arguments as an array, which starts after the job AFTER has ended.
submit() {
    {
        printf '#!/usr/bin/env bash\ncd %q || exit\nexec' "$PWD"
        printf ' %q' "${command[@]}"
        printf ' %s\n' "$3"
    } | sbatch --parsable --job-name=@NAME@ --array="$2" --output="${logs//%/%%}/@$4.log" ${1:+--dependency="afterany:$1"} "${options[@]}"
}

warm=$(submit "" 0 '--warm @THREADS@' warm)
tasks=$(submit "$warm" 0-@LAST@@AT-ONCE@ '@CHUNK@--task $SLURM_ARRAY_TASK_ID @THREADS@' %a)
sheet=$(submit "$tasks" 0 --report sheet)
echo "$warm $tasks $sheet"
