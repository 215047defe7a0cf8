#!/usr/bin/env python3
"""@TASKS@ tasks for HyperQueue: `python3 THIS [SERVER DIRECTORY]`, or `python3 THIS --here` without a server. It waits for them and makes the
contact sheet, whatever came of them. The first task leaves in the cache what the others have in common. What jobs print is in the folder of
logs."""
import os
import subprocess
import sys

from hyperqueue import Client, Job, LocalCluster
@IMPORT@
COMMAND = @COMMAND@
FOLDER = @FOLDER@
LOGS = os.path.join(FOLDER, @LOGS@)
HERE = sys.argv[1:] == ["--here"]


def submitted(client, *calls):
    """Runs the command with each of these words, whose last one names its log. Returns how many failed."""
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
    failed = submitted(client, ["--warm"])
    if failed:
        # None of the others can run either: the tasks are not those that were handed over.
        failed = len(calls)
    else:
        # So many run at a time.
        for first in range(0, len(calls), @AT-ONCE@):
            failed += submitted(client, *calls[first:first + @AT-ONCE@])
    # It runs here, so that what it reports is seen.
    is_complete = subprocess.run([*COMMAND, "--report"], cwd=FOLDER).returncode == 0
    print(f"{len(calls) - failed} done, {failed} failed")
    return 0 if is_complete and not failed else 1


if HERE:
    with LocalCluster() as cluster:
        cluster.start_worker()
        sys.exit(run(cluster.client()))
sys.exit(run(Client(*sys.argv[1:])))
