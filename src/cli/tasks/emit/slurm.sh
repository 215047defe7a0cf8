#!/usr/bin/env bash
# @TASKS@ tasks for Slurm: `bash THIS [OPTIONS OF SBATCH]`. The first job leaves in the cache what the tasks have in common, and the last one
# makes the contact sheet, whatever came of the tasks. What jobs print is in the folder of logs.
set -euo pipefail
cd @FOLDER@
command=(@COMMAND@)
logs=@LOGS@
options=(@RESOURCES@ "$@")
mkdir -p "$logs"

# Submits the command with more words as an array, behind another job. Its log has the last word as its name.
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
