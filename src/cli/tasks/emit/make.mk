# @TASKS@ tasks for GNU make: `make -f THIS -j 4`. The first job leaves in the cache what the tasks have in common. The last one makes the
# contact sheet, whatever came of the tasks, and fails unless all are done.
@AT-ONCE@.PHONY: sheet warm @JOBS@
sheet: @JOBS@
	@cd @FOLDER@ && @COMMAND@ --report
@JOBS@: warm
	-@cd @FOLDER@ && @COMMAND@ @CHUNK@--task $@
warm:
	-@cd @FOLDER@ && @COMMAND@ --warm
