#!/usr/bin/env python3
"""@TASKS@ tasks for HyperQueue: `python3 THIS [SERVER DIRECTORY]`, or `python3 THIS --here` without a server. Waits for the tasks and makes
the contact sheet, even if tasks fail. The first job computes what the tasks have in common and leaves it in the cache. The output of jobs
is in the folder of logs."""
import os
import subprocess
import sys

from hyperqueue import Client, Job, LocalCluster
@IMPORT@
COMMAND = @COMMAND@
FOLDER = @FOLDER@
LOGS = os.path.join(FOLDER, @LOGS@)
HERE = sys.argv[1:] == ["--here"]


def submit(client, *calls):
    """Runs the command once with each list of arguments, whose last one names the log. Returns the number of failed runs."""
    job = Job(default_workdir=FOLDER, max_fails=None, name=@NAME@)
    for words in calls:
        log = os.path.join(LOGS, "@" + words[-1].strip("-"))
        job.program([*COMMAND, *words], stdout=log + ".log", stderr=log + ".err.log", resources=@RESOURCES@)
    job = client.submit(job)
    is_done = client.wait_for_jobs([job], raise_on_error=False)
    return 0 if is_done else len(client.get_failed_tasks(job))


def run(client):
    os.makedirs(LOGS, exist_ok=True)
    calls = [[*@CHUNK@, "--task", str(job)] for job in range(@JOBS@)]
    failed = submit(client, ["--warm"])
    if failed:
        # The tasks have changed since the handover, so none of the others can run either.
        failed = len(calls)
    else:
        # In groups of the maximum number of jobs that may run at a time.
        for first in range(0, len(calls), @AT-ONCE@):
            failed += submit(client, *calls[first:first + @AT-ONCE@])
    # Runs here, not as a job, so that its report is visible.
    is_complete = subprocess.run([*COMMAND, "--report"], cwd=FOLDER).returncode == 0
    print(f"{len(calls) - failed} done, {failed} failed")
    return 0 if is_complete and not failed else 1


if HERE:
    with LocalCluster() as cluster:
        cluster.start_worker()
        sys.exit(run(cluster.client()))
sys.exit(run(Client(*sys.argv[1:])))
