# @TASKS@ tasks for GNU make: `make -f THIS -j 4`. The first job computes what the tasks have in common and leaves it in the cache. The last
# one makes the contact sheet, even if tasks fail, and fails unless all tasks are done.
@AT-ONCE@.PHONY: sheet warm @JOBS@
sheet: @JOBS@
	@cd @FOLDER@ && @COMMAND@ --report
@JOBS@: warm
	-@cd @FOLDER@ && @COMMAND@ @CHUNK@--task $@
warm:
	-@cd @FOLDER@ && @COMMAND@ --warm
