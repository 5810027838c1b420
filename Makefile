# Two commands set everything up: `make demo` and `make test`. They need python3 (3.11 or newer).
PYTHON ?= python3
BIN := .venv/bin
RUN_STAMP := .venv/.run-stamp
TEST_STAMP := .venv/.test-stamp
BENCH_STAMP := .venv/.bench-stamp
MADE := .pytest_cache
# what Python compiles is kept: every process that a test starts would compile the packages anew
unexport PYTHONDONTWRITEBYTECODE
# one worker more than processors, as they wait for servers and viewers; each takes up to a gigabyte
WORKERS := $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)
PARALLEL := -n $(WORKERS) --maxprocesses 9 --dist loadfile --no-loadscope-reorder

.PHONY: heavy fleet fleet-s3 fleet-speed fleet-years fleet-size unseen shift-speed demo test test-times check lint types tests slow golden golden-update docs calibration campaign coverage decoding forgetting gates honesty findings findings-kept mended unlisted shifts shift-coverage payloads degenerate independent-shifts reproduction reading writing speed memory fuzz lock clean help
.DELETE_ON_ERROR:

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

demo: $(RUN_STAMP) ## simulate the calibration campaign and a shift as real logs, show the answers
	$(BIN)/payscope warm-up
	$(BIN)/payscope demo -o demo --force

# types beside the compilation and the tests, so that no processor waits; what they say comes last
test: lint ## lint, strict types and the tests but those that are heavy
	@mkdir -p $(MADE)
	@$(MAKE) --no-print-directory types >$(MADE)/types.txt 2>&1 & types=$$!; \
	$(MAKE) --no-print-directory tests; tests=$$?; \
	wait $$types; types=$$?; cat $(MADE)/types.txt; exit $$((tests || types))

check: $(TEST_STAMP) ## lint, types and tests of what changed since the upstream branch (a minute)
	$(BIN)/python .ci/check.py

lint: $(TEST_STAMP) ## ruff's rules and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(TEST_STAMP) ## strict types
	$(BIN)/basedpyright

tests: $(TEST_STAMP) ## the tests but the heavy ones, in parallel; a file's tests share its fixtures
	$(BIN)/payscope warm-up
	$(BIN)/python -m pytest $(PARALLEL) -m "not slow and not heavy"

test-times: $(TEST_STAMP) ## tests and heavy tests, and which files and tests took most of the processor
	$(BIN)/payscope warm-up
	$(BIN)/python -m pytest $(PARALLEL) -m "not slow" --processor-times

heavy: $(TEST_STAMP) ## the tests of a second of the processor and more each (a quarter of an hour)
	$(BIN)/payscope warm-up
	$(BIN)/python -m pytest $(PARALLEL) -m "heavy and not slow"

slow: $(TEST_STAMP) ## the same statements over many trials and examples (an hour)
	$(BIN)/python -m pytest $(PARALLEL) -m slow --hypothesis-profile unseen

unseen: $(TEST_STAMP) ## the tests with examples drawn anew, where others repeat their own (half an hour)
	$(BIN)/python -m pytest $(PARALLEL) -m "not slow" --hypothesis-profile unseen

$(BIN)/python:
	$(PYTHON) .ci/make_environment.py .venv

$(RUN_STAMP): requirements.lock pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

$(TEST_STAMP): requirements-dev.lock $(RUN_STAMP)
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-dev.lock
	@touch $@

$(BENCH_STAMP): requirements-bench.lock $(TEST_STAMP)
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-bench.lock
	@touch $@

golden: $(TEST_STAMP) ## small logs give the results that are kept, bit for bit on the processor they are of
	$(BIN)/python -m pytest tests/golden

golden-update: $(TEST_STAMP) ## keep the results of the golden logs as they are now
	$(BIN)/python -m tests.golden.golden

docs: $(TEST_STAMP) ## run the documentation's commands and write down what comes out
	$(BIN)/python -P docs/update.py
	$(BIN)/python -P docs/decision_index.py
	$(BIN)/python -P docs/api_reference.py

campaign: $(TEST_STAMP) ## the demo's campaign over 20 seeds (four minutes)
	$(BIN)/python -P benchmarks/campaign.py

coverage: $(TEST_STAMP) ## how often 95 % intervals contain the truth, into the documentation (fifteen minutes)
	$(BIN)/python -P benchmarks/intervals.py --write

calibration: $(TEST_STAMP) ## how often intervals of calibrated masses hold, into the documentation (half an hour)
	$(BIN)/python -P benchmarks/calibration.py --write

forgetting: $(TEST_STAMP) ## which λ to forget with, into the documentation (four minutes)
	$(BIN)/python -P benchmarks/forgetting.py --write

gates: $(TEST_STAMP) ## the three gates compared, into the documentation (fifteen minutes)
	$(BIN)/python -P benchmarks/gates.py --write

honesty: $(TEST_STAMP) ## whether the answer's interval holds on machines unlike the model, into the documentation (an hour)
	$(BIN)/python -P benchmarks/honesty.py --write

findings-kept: $(TEST_STAMP) ## print what findings name otherwise than before in small logs, and keep it (half a minute)
	$(BIN)/python -m tests.analysis.findings.kept

unlisted: $(TEST_STAMP) ## faults outside the table of injected ones: shown, named, and whether mending does harm (two hours)
	$(BIN)/python -P benchmarks/unlisted_faults.py --json unlisted.jsonl
	$(BIN)/python -P benchmarks/applied.py --json applied.jsonl

mended: $(TEST_STAMP) ## whether a machine file mended by `explain --apply` gives the mass back, into the documentation (ten minutes)
	$(BIN)/python -P benchmarks/mended.py --write

findings: $(TEST_STAMP) ## whether findings name the fault that was put into a log, into the documentation, before a release (two hours)
	$(BIN)/python -P benchmarks/findings.py --write

shifts: $(TEST_STAMP) ## twenty drawn shifts as logs, reviewed and compared with the truth, into the documentation (an hour)
	$(BIN)/python -P benchmarks/shifts.py --write

shift-coverage: $(TEST_STAMP) ## how often intervals of payloads and tonnes hold over 400 shifts, into the documentation (ten minutes)
	$(BIN)/python -P benchmarks/shift_coverage.py --write

payloads: $(TEST_STAMP) ## payload by difference on logs of the independent bench; goes on with payloads.jsonl (an hour or two)
	$(BIN)/python -P benchmarks/payloads.py --json payloads.jsonl

degenerate: $(TEST_STAMP) ## every command on 10,000 tables that no machine would record; goes on with degenerate_tables.jsonl (two hours and a half)
	$(BIN)/python -P benchmarks/degenerate_tables.py --json degenerate_tables.jsonl

independent-shifts: $(TEST_STAMP) ## sixty shifts of the independent bench, reviewed; goes on with independent_shifts.jsonl (an hour)
	$(BIN)/python -P benchmarks/independent_shifts.py --json independent_shifts.jsonl

reproduction: $(TEST_STAMP) ## the paper's tables, figures and claims found anew (a few minutes)
	$(BIN)/payscope reproduce --trials 1000 --campaigns 20 -o docs/reproduction --force

speed: $(BENCH_STAMP) ## the estimators against statsmodels, pandas, NumPy and padasip (two minutes)
	$(BIN)/python -P benchmarks/speed.py

memory: $(RUN_STAMP) ## the peak memory of a twelve-hour shift through every estimator (two minutes)
	$(BIN)/python -P benchmarks/memory.py

decoding: $(TEST_STAMP) ## the columnar decoder against rosbags over 2500 random types in each encoding (ten minutes)
	PAYSCOPE_RANDOM_TYPES=2500 $(BIN)/python -m pytest tests/replay/logs/decoding/test_equality.py
	PAYSCOPE_RANDOM_TYPES=250 $(BIN)/python -m pytest tests/replay/logs/decoding/test_damage.py

fuzz: $(TEST_STAMP) ## 600 damaged logs of each of 21 containers: no crash, no hang, nothing lost in silence (ten minutes)
	PAYSCOPE_FUZZ_FILES=600 $(BIN)/python -m pytest -s tests/replay/logs/fuzz

writing: $(TEST_STAMP) ## simulated logs written by columns and message by message, into the documentation (ten minutes)
	$(BIN)/python -P benchmarks/simulate.py --write

shift-speed: $(BENCH_STAMP) ## a review against the script that a user would write, and where its time goes (ten minutes)
	$(BIN)/python -P benchmarks/review.py --write

fleet: $(TEST_STAMP) ## 300 recordings on three nodes here, a worker and a node killed, against a serial replay (ten minutes)
	$(BIN)/python -P benchmarks/fleet_cluster.py --recordings 300

fleet-s3: $(TEST_STAMP) ## a fleet in object storage, whose server goes away in the middle (five minutes)
	$(BIN)/python -P benchmarks/fleet_s3.py

fleet-speed: $(TEST_STAMP) ## two workers against one, what a recording costs besides its replay, into the documentation (five minutes)
	$(BIN)/python -P benchmarks/fleet_speed.py --write

fleet-years: $(TEST_STAMP) ## drifts of simulated years, and false alarms, into the documentation (two minutes)
	$(BIN)/python -P benchmarks/fleet_years.py --write

fleet-size: $(TEST_STAMP) ## query and report of 50 machines × 200 days (five minutes)
	$(BIN)/python -P benchmarks/fleet_size.py

reading: $(BENCH_STAMP) ## logs to columns against other readers and the limit (ten minutes)
	$(BIN)/python -P benchmarks/decode.py

lock: ## resolve the dependencies anew, for every Python from 3.11 (needs uv)
	uv pip compile pyproject.toml --group build --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-header --no-annotate --quiet -o requirements.lock
	uv pip compile pyproject.toml --group build --group dev --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-header --no-annotate --quiet -c requirements.lock -o requirements-dev.lock
	uv pip compile pyproject.toml --group build --group dev --group bench --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-header --no-annotate --quiet -c requirements-dev.lock -o requirements-bench.lock

clean: ## remove the environment and what the tools cached
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis demo
