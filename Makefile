# Relief: what does accuracy cost in time when you draw large terrain?
# `make help` lists the targets.  Overrides (CC, CFLAGS, PREFIX ...) may stand in local.mk, which git ignores.
-include local.mk

config ?= release# release | debug | sanitize
PREFIX ?= /usr/local
CC     ?= gcc
BUILD  := $(if $(filter release,$(config)),build,build/$(config))
OBJ    := $(BUILD)/obj

# ---- packages (Debian names) ----------------------------------------------------------------------------------
PACKAGES := gcc libc6-dev make pkg-config git clang-format cppcheck libepoxy-dev libglfw3-dev libosmesa6-dev \
            libegl-dev libegl-mesa0 libgl1-mesa-dri libglx-mesa0 libcjson-dev libpng-dev libcmocka-dev gnuplot-nox \
            xvfb xauth libxml2-utils clang zlib1g-dev libopenjp2-7-dev libcharls-dev liblerc-dev
LIBRARIES := epoxy glfw3 libcjson libpng zlib
GDAL      := $(shell pkg-config --exists gdal 2>/dev/null && echo gdal)
# Other coders, for `terrain compare` alone; what is missing is said there.
CODERS    := $(foreach c,OPENJPEG=libopenjp2 CHARLS=charls LERC=Lerc,\
             $(shell pkg-config --exists $(lastword $(subst =, ,$c)) 2>/dev/null && echo $c))
CODER_LIBRARIES := $(foreach c,$(CODERS),$(lastword $(subst =, ,$c)))

# ---- flags ----------------------------------------------------------------------------------------------------
# Numbers must not depend on the compiler's mood: no contraction, never -ffast-math (numerics.md, section 0).
OPTIMISE_release  := -O2 -g
OPTIMISE_debug    := -O0 -g
OPTIMISE_sanitize := -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
WARNINGS := -Wall -Wextra -Wpedantic -Wshadow -Wvla -Wstrict-prototypes -Wmissing-prototypes -Wdouble-promotion
FLAGS    := -std=c11 -D_DEFAULT_SOURCE $(OPTIMISE_$(config)) $(WARNINGS) $(if $(werror),-Werror) -ffp-contract=off \
            -fno-fast-math -pthread -I. $(if $(GDAL),-DRELIEF_GDAL) $(foreach c,$(CODERS),-DRELIEF_$(firstword $(subst =, ,$c))) \
            -DRELIEF_BUILD='"$(OPTIMISE_$(config))"' \
            -DRELIEF_COMMIT='"$(shell git rev-parse --short HEAD 2>/dev/null || echo unknown)"' \
            $(shell pkg-config --cflags $(LIBRARIES) $(GDAL) $(CODER_LIBRARIES) 2>/dev/null) $(CFLAGS)
LINK     := -Wl,--as-needed -pthread $(OPTIMISE_$(config)) $(LDFLAGS)
LIBS     := $(shell pkg-config --libs $(LIBRARIES) $(GDAL) $(CODER_LIBRARIES) 2>/dev/null) -ldl -lm

# ---- files ----------------------------------------------------------------------------------------------------
RENDERERS := clipmap geomipmap pgm
EMBEDDED  := $(wildcard common/gl/*.glsl common/gl/*.vert common/gl/*.geom common/gl/*.frag $(RENDERERS:%=%/*.vert) $(RENDERERS:%=%/*.frag) $(RENDERERS:%=%/*.glsl) bench/*.vert \
             common/terrain/jacksboro* bench/scenes/default.json)
MAINS     := $(wildcard common/terrain/main.c bench/main.c $(RENDERERS:%=%/main.c))
sources    = $(filter-out $(MAINS),$(wildcard $(1)))
objects    = $(patsubst %.c,$(OBJ)/%.o,$(1))
COMMON    := $(call objects,$(call sources,common/*.c common/*/*.c common/*/*/*.c)) $(OBJ)/embedded.o $(OBJ)/epoxy_table.o
METHODS   := $(call objects,$(call sources,$(RENDERERS:%=%/*.c)))
BENCH     := $(call objects,$(call sources,bench/*.c bench/*/*.c))
PROGRAMS  := $(patsubst %/main.c,%,$(MAINS:common/%=%))
TESTS     := $(patsubst %.c,$(BUILD)/%,$(wildcard tests/hard/test_*.c tests/gpu/test_*.c tests/unit/test_*.c)) # long ones first
HEADERS   := $(wildcard common/*.h common/*/*.h common/*/*/*.h $(RENDERERS:%=%/*.h) bench/*.h bench/*/*.h tests/*.h tests/*/*.h)
ALL_C     := $(wildcard common/*.c common/*/*.c common/*/*/*.c $(RENDERERS:%=%/*.c) bench/*.c bench/*/*.c tests/*/*.c) $(HEADERS)

all: $(PROGRAMS:%=$(BUILD)/%) ## the programs: bench, clipmap, geomipmap, pgm, terrain

$(OBJ)/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(CC) $(FLAGS) -MMD -MP -c $< -o $@

# One table of the files that the programs carry (common/embedded.h).
$(OBJ)/embedded.S: $(EMBEDDED) Makefile
	@mkdir -p $(@D)
	@{ n=0; printf '.section .rodata\n'; for f in $(EMBEDDED); do \
	   printf 'name%d: .asciz "%s"\ndata%d: .incbin "%s"\nend%d: .byte 0\n' $$n $$f $$n $$f $$n; n=$$((n+1)); done; \
	   printf '.section .data.rel.ro,"aw"\n.balign 8\n.globl embedded_files\nembedded_files:\n'; n=0; \
	   for f in $(EMBEDDED); do printf '.quad name%d, data%d, end%d\n' $$n $$n $$n; n=$$((n+1)); done; \
	   printf '.section .rodata\n.balign 8\n.globl embedded_file_count\nembedded_file_count: .quad %d\n' $$n; \
	   printf '.section .note.GNU-stack,"",%%progbits\n'; } > $@
$(OBJ)/embedded.o: $(OBJ)/embedded.S
	$(CC) -c $< -o $@

# One table of libepoxy's function pointers (common/gl/epoxy_table.h), read off its header.
$(OBJ)/epoxy_table.c: Makefile
	@mkdir -p $(@D)
	@{ printf '#include "common/gl/epoxy_table.h"\n#include <epoxy/gl.h>\nconst struct epoxy_entry epoxy_table[] = {\n'; \
	   echo '#include <epoxy/gl.h>' | $(CC) $(FLAGS) -E -dM - | sort | \
	   sed -nE 's/^#define (gl[A-Z][A-Za-z0-9]*) epoxy_\1$$/{"\1", (void *)\&epoxy_\1},/p'; \
	   printf '};\nconst size_t epoxy_table_count = sizeof epoxy_table / sizeof *epoxy_table;\n'; } > $@
$(OBJ)/epoxy_table.o: $(OBJ)/epoxy_table.c common/gl/epoxy_table.h
	$(CC) $(FLAGS) -c $< -o $@

$(OBJ)/libcommon.a: $(COMMON)
$(OBJ)/libmethods.a: $(METHODS)
$(OBJ)/libbench.a: $(BENCH)
$(OBJ)/lib%.a:
	@rm -f $@
	ar rcs $@ $^

$(BUILD)/terrain: $(OBJ)/common/terrain/main.o $(OBJ)/libcommon.a
	$(CC) $(LINK) $^ $(LIBS) -o $@
$(BUILD)/bench: $(OBJ)/bench/main.o $(OBJ)/libbench.a $(OBJ)/libmethods.a $(OBJ)/libcommon.a
	$(CC) $(LINK) $^ $(LIBS) -o $@
$(RENDERERS:%=$(BUILD)/%): $(BUILD)/%: $(OBJ)/%/main.o $(OBJ)/libmethods.a $(OBJ)/libcommon.a
	$(CC) $(LINK) $^ $(LIBS) -o $@

$(BUILD)/tests/%: $(OBJ)/tests/%.o $(OBJ)/libbench.a $(OBJ)/libmethods.a $(OBJ)/libcommon.a
	@mkdir -p $(@D)
	$(CC) $(LINK) $^ $(shell pkg-config --libs cmocka) $(LIBS) -o $@

$(BUILD)/tests/unit/test_fuzz: $(OBJ)/tests/fuzz/fuzz_relief.o

-include $(shell find $(OBJ) -name '*.d' 2>/dev/null)
.SECONDARY:

deps: ## install the Debian packages that building, testing and reporting need (asks first when not root)
	@missing=$$(for p in $(PACKAGES); do dpkg -s $$p 2>/dev/null | grep -q '^Status: install ok' || echo $$p; done); \
	 if [ -z "$$missing" ]; then echo "deps: everything is installed"; \
	 elif [ "$$(id -u)" = 0 ]; then apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$missing; \
	 else echo "deps: these packages are missing:" $$missing; sudo apt-get update && sudo apt-get install --no-install-recommends $$missing; fi

# Earth for those who have no map of it: NOAA's ETOPO5, public domain, out of Debian's ferret-datasets; scenes look
# into data/ first.
ETOPO5 ?= /usr/share/ferret-vis/data/etopo5.cdf
data: ## Earth's relief (ETOPO5, from Debian's ferret-datasets) and tints for it, to data/ where the earth scenes find them
	$(MAKE) --no-print-directory $(BUILD)/terrain
	@if [ ! -r $(ETOPO5) ]; then $(MAKE) --no-print-directory deps PACKAGES=ferret-datasets; fi
	mkdir -p data
	$(BUILD)/terrain import $(ETOPO5) data/earth_etopo5_4320x2161.png
	$(BUILD)/terrain tint data/earth_etopo5_4320x2161.png data/earth_colour_4096x2048.png --size 4096x2048

# `make deps bench` on a new machine: pkg-config did not know the libraries when this file was read, so the work
# is done by a make that starts after deps.
bench: | $(filter deps,$(MAKECMDGOALS)) ## the main job: fly the default scene through every renderer, leave reports/default/index.html
	$(MAKE) --no-print-directory $(BUILD)/bench
	$(BUILD)/bench run --out reports/default

papers: | $(filter deps,$(MAKECMDGOALS)) ## tables of the papers, measured again; leave reports/papers/papers.html
	$(MAKE) --no-print-directory $(BUILD)/bench
	$(BUILD)/bench papers --out reports/papers

test: | $(filter deps,$(MAKECMDGOALS)) ## every test at its everyday size
	$(MAKE) --no-print-directory run-tests

soak: | $(filter deps,$(MAKECMDGOALS)) ## the same properties at their full stated sizes (an hour or so)
	RELIEF_SOAK=1 $(MAKE) --no-print-directory run-tests
	$(MAKE) --no-print-directory fuzz

run-tests: all $(TESTS)
	tests/run $(BUILD) $(TESTS)

FUZZED  := tests/fuzz/fuzz_relief.c $(wildcard $(addprefix common/terrain/relief/,coder*.c layout*.c codec_*.c)) \
           $(patsubst %,common/terrain/%.c,relief/relief_file relief/relief_format sphere upsample) common/parallel.c common/report.c
runs    ?= 1000000
fuzz: $(BUILD)/tests/unit/test_fuzz ## spoilt .relief files under libFuzzer and sanitizers (clang): runs=1000000
	@mkdir -p $(BUILD)/fuzz/corpus
	RELIEF_CORPUS=$(BUILD)/fuzz/corpus $(BUILD)/tests/unit/test_fuzz >/dev/null
	clang -std=c11 -D_DEFAULT_SOURCE -O2 -g -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all \
	  -DRELIEF_LIBFUZZER -pthread -I. $(FUZZED) -lz -lm -o $(BUILD)/fuzz/fuzz_relief
	$(BUILD)/fuzz/fuzz_relief -runs=$(runs) -seed=1 -max_len=8192 -timeout=10 -rss_limit_mb=512 -close_fd_mask=2 \
	  -artifact_prefix=$(BUILD)/fuzz/ -print_final_stats=1 $(BUILD)/fuzz/corpus

check: format-check layers headers lint ## before each commit: format, layers, headers, lint, tests under sanitizers
	$(MAKE) --no-print-directory config=sanitize run-tests

format: ## lay the sources out
	clang-format -i $(ALL_C)
format-check:
	clang-format --dry-run -Werror $(ALL_C)

lint: ## cppcheck over the sources
	cppcheck --quiet --std=c11 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
	  --suppress=missingIncludeSystem -I. common clipmap geomipmap pgm bench

layers: ## common/ knows no renderer; renderers know neither each other nor bench/
	@! grep -nE '#include "(clipmap|geomipmap|pgm|bench|tests)/' common/*.[ch] common/*/*.[ch] common/*/*/*.[ch]
	@for d in $(RENDERERS); do ! grep -nE '#include "' $$d/*.[ch] | grep -vE '"(common|'$$d')/' || exit 1; done
	@! grep -nE '#include "tests/' bench/*.[ch] bench/*/*.[ch]
	@! grep -nE '^#include .*(epoxy|GL/)' common/terrain/*.[ch] common/terrain/*/*.[ch] common/view/*.[ch] common/scene/*.[ch]
	@! grep -rnE -e '-f''fast-math' --include='*.mk' --include=Makefile . | grep -v 'never\|fno-fast-math\|grep'
	@echo "layers: good"

headers: ## each header compiles by itself
	@for h in $(HEADERS); do echo "#include \"$$h\"" | $(CC) $(FLAGS) -Wno-unused -fsyntax-only -x c - || exit 1; done
	@echo "headers: good"

# What the coder counts hangs on its tables: a guess, then three rounds.  Never trained on maps that figures are quoted for.
TRAINING := bigtujunga_30m_1197x643 everest_srtm3_1201 jacksboro_403x344
tables: ## train the tile coder's tables on the maps of $RELIEF_DATA that are meant for it (some minutes)
	for round in 0 1 2 3; do \
	  $(MAKE) --no-print-directory $(BUILD)/tests/tools/train_coder && $(BUILD)/tests/tools/train_coder \
	    $$([ $$round = 0 ] || printf '%s ' $(TRAINING:%="$$RELIEF_DATA"/%.png)) > $(BUILD)/coder_tables.c && \
	  cp $(BUILD)/coder_tables.c common/terrain/relief/coder_tables.c || exit 1; done

# 20.2e9 samples; takes up to 3 GB of disk below build/, and goes on where it was when it is interrupted.
us-scale: ## pack a made world of 216,000 x 93,600 samples: build/us.relief (half an hour on two cores)
	$(MAKE) --no-print-directory $(BUILD)/terrain
	$(BUILD)/terrain pack bench/worlds/us.json $(BUILD)/us.relief --rms 2 --progress

earth-scale: ## pack a whole Earth of 43,200 x 21,601 samples, made from the 5' map of $RELIEF_DATA: build/earth.relief
	$(MAKE) --no-print-directory $(BUILD)/terrain
	$(BUILD)/terrain pack bench/worlds/earth.json $(BUILD)/earth.relief --rms 8 --progress

report: $(BUILD)/bench ## rebuild reports/default/index.html from its results.json
	$(BUILD)/bench report reports/default

install: all ## programs to $(PREFIX)/bin
	install -d $(DESTDIR)$(PREFIX)/bin
	for p in $(PROGRAMS); do install -m 755 $(BUILD)/$$p $(DESTDIR)$(PREFIX)/bin/relief-$$p; done

clean: ## remove what was built
	rm -rf build

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

.PHONY: all deps data bench papers us-scale earth-scale tables test soak run-tests fuzz check format format-check lint layers headers report install clean help
