# mechkit: one non-recursive Makefile. `make help` lists the targets.
#
# Variants live beside each other in build/<variant>/: release (default), debug, asan (with UBSan),
# tsan, cov. `make VARIANT=asan tests` builds one; the check-* targets pick theirs.

MAKEFLAGS += --no-builtin-rules

VERSION := $(shell cat VERSION)
VARIANT ?= release
BUILD   ?= build
B       := $(BUILD)/$(VARIANT)

CC        ?= cc
CXX       ?= c++
AR        ?= ar
STRIP     ?= strip
PKGCONFIG ?= pkg-config
PYTHON    ?= python3
CLANG     ?= clang
CLANG_FORMAT ?= clang-format
CLANG_TIDY   ?= clang-tidy

PREFIX     ?= /usr/local
BINDIR     ?= $(PREFIX)/bin
LIBDIR     ?= $(PREFIX)/lib
INCLUDEDIR ?= $(PREFIX)/include
DATADIR    ?= $(PREFIX)/share
SYSCONFDIR ?= $(if $(filter /usr,$(PREFIX)),/etc,$(PREFIX)/etc)
MANDIR     ?= $(DATADIR)/man

# --- flags --------------------------------------------------------------------------------------
# Warnings are errors with WERROR=1 (CI). Sign conversions are left out: counts and sizes meet in
# every index, and the noise hides what matters.
WARN   := -Wall -Wextra -Wpedantic -Wshadow -Wundef -Wvla -Wformat=2 -Wcast-qual \
          -Wpointer-arith -Wwrite-strings -Wdouble-promotion -Wconversion -Wno-sign-conversion
CWARN  := -Wstrict-prototypes -Wmissing-prototypes
ifeq ($(WERROR),1)
WARN   += -Werror
endif

OPT_release := -O2 -g1
OPT_debug   := -O0 -g3
OPT_asan    := -O1 -g1 -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
OPT_tsan    := -O1 -g1 -fsanitize=thread
OPT_cov     := -O0 -g --coverage
OPT := $(OPT_$(VARIANT))

# The hardening that Debian's packages have; _FORTIFY_SOURCE needs optimisation, and a package sets its own.
ifeq ($(VARIANT),release)
HARDEN     := -fstack-protector-strong
HARDEN_CPP := $(if $(findstring _FORTIFY_SOURCE,$(CPPFLAGS) $(CFLAGS)),,-U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=2)
HARDEN_LD  := -Wl,-z,relro -Wl,-z,now
endif
ifeq ($(OPT),)
$(error unknown VARIANT '$(VARIANT)': release, debug, asan, tsan or cov)
endif

# Libraries come from pkg-config; SUNDIALS 6 ships no .pc file, so it is named by hand
# (libsundials_core exists from 7.0 on, and where it was built with MPI its headers name MPI's).
PKGS := eigen3 libcjson inih zlib libusb-1.0 matio
ifneq ($(filter-out help clean deps,$(or $(MAKECMDGOALS),all)),)
PKG_CFLAGS := $(shell $(PKGCONFIG) --cflags $(PKGS) 2>/dev/null | sed 's/-I/-isystem /g')
PKG_LIBS   := $(shell $(PKGCONFIG) --libs $(PKGS) 2>/dev/null)
TUI_CFLAGS := $(shell $(PKGCONFIG) --cflags ncursesw 2>/dev/null | sed 's/-D_XOPEN_SOURCE=[0-9]*//')
TUI_LIBS   := $(shell $(PKGCONFIG) --libs ncursesw 2>/dev/null)
# Sweeps over several machines, where Open MPI is there; MPI=0 builds without. Sanitizers would report
# Open MPI's own leaks and races.
ifneq ($(filter asan tsan,$(VARIANT)),)
MPI        ?= 0
endif
MPI        ?= $(shell $(PKGCONFIG) --exists ompi-c 2>/dev/null && echo 1)
SUN_CORE   := $(shell printf 'int main(void){return 0;}' | $(CC) -x c - -o /dev/null -lsundials_core 2>/dev/null && echo -lsundials_core)
ifneq ($(SUN_CORE),)
SUN_HAS_MPI := $(shell printf '\043include <sundials/sundials_config.h>\n\043if SUNDIALS_MPI_ENABLED\nyes\n\043endif\n' | $(CC) -E -P - 2>/dev/null)
ifneq ($(findstring yes,$(SUN_HAS_MPI)),)
SUN_MPI        := $(shell for p in mpi-c ompi-c mpich; do $(PKGCONFIG) --exists $$p 2>/dev/null && echo $$p && break; done)
SUN_MPI_CFLAGS := $(shell $(PKGCONFIG) --cflags $(SUN_MPI) 2>/dev/null | sed 's/-I/-isystem /g')
SUN_MPI_LIBS   := $(shell $(PKGCONFIG) --libs $(SUN_MPI) 2>/dev/null || echo -lmpi)
endif
endif
endif
SUN_LIBS   := -lsundials_cvode -lsundials_arkode -lsundials_nvecserial \
              -lsundials_sunmatrixdense -lsundials_sunlinsoldense $(SUN_CORE) $(SUN_MPI_LIBS)

CPPFLAGS_ALL := $(HARDEN_CPP) -Iinclude -Isrc -D_GNU_SOURCE -DMK_VERSION='"$(VERSION)"' $(PKG_CFLAGS) $(CPPFLAGS)
# The public headers make their functions visible; calls between them stay direct all the same.
PIC          := -fPIC -fvisibility=hidden -fno-semantic-interposition
CFLAGS_ALL   := -std=c11 $(OPT) $(HARDEN) $(PIC) -pthread $(WARN) $(CWARN) $(CFLAGS)
CXXFLAGS_ALL := -std=c++17 $(OPT) $(HARDEN) $(PIC) -pthread $(WARN) $(CXXFLAGS)
LDLIBS_ALL   := $(SUN_LIBS) $(PKG_LIBS) -lm $(LDLIBS)

# `make V=1` shows whole commands.
ifneq ($(V),1)
Q = @printf '  %-4s %s\n'
say = $(Q) $(1) $@;
endif

# --- sources ------------------------------------------------------------------------------------
LIB_DIRS := base model sim ctrl driver ident exchange experiment explain explain/search explain/evidence \
            explain/report investigate
LIB_C    := $(foreach d,$(LIB_DIRS),$(wildcard src/$(d)/*.c))
LIB_CXX  := $(foreach d,$(LIB_DIRS),$(wildcard src/$(d)/*.cpp))
APP_C    := $(wildcard src/console/*/*.c)
EMU_C    := $(filter-out %/plugged.c %/bench.c %/stream.c,$(wildcard tests/emu/*.c))
TEST_C   := $(wildcard tests/*.c tests/support/*.c) $(EMU_C) tests/emu/bench.c tests/emu/stream.c
TEST_CXX := $(wildcard tests/test_*.cpp tests/support/*.cpp)

# The fast path is one source compiled once per instruction set and chosen when the program runs.
ISA_SRC   := src/sim/fast_kernel.cc
ARCH      := $(shell uname -m)
# Sanitizers and coverage look at one build of it: instrumented, it takes the compiler minutes.
ifeq ($(ARCH)/$(filter release debug,$(VARIANT)),x86_64/$(VARIANT))
ISAS      := generic avx2 avx512
CPPFLAGS_ALL += -DMK_WIDE_KERNELS
endif
ISAS      ?= generic
# Fused multiply-adds; nothing here depends on the sign of zero or on floating-point traps. Only the
# release is worth the compiler's time.
ifeq ($(VARIANT),release)
FUSED := -O3 -fno-tree-slp-vectorize
endif
FUSED += -ffp-contract=fast -fno-math-errno -fno-trapping-math -fno-signed-zeros
ISA_FLAGS_generic :=
# What src/sim/instruction_sets.hpp asks for.
ISA_FLAGS_avx2    := -mavx2 -mfma -mbmi -mbmi2 $(FUSED)
ISA_FLAGS_avx512  := $(ISA_FLAGS_avx2) -mavx512f -mavx512dq -mavx512vl -mprefer-vector-width=512
# The shooting kernel besides for one stretch and for as many as go side by side, without and with
# derivatives (0, 1).
SHOOT_SRC           := src/sim/shoot_kernel.cc
SHOOT_WIDTH_generic := 2
SHOOT_WIDTH_avx2    := 4
SHOOT_WIDTH_avx512  := 8
# What -O3 does beyond vectorising doubles its code and the compiler's time, and makes it no faster.
ifeq ($(VARIANT),release)
SHOOT_OPT_avx2      := -O2 -ftree-vectorize -fvect-cost-model -fno-tree-slp-vectorize
SHOOT_OPT_avx512    := $(SHOOT_OPT_avx2)
endif
SHOOT_SIZES   = $(foreach w,1 $(SHOOT_WIDTH_$(1)),$(w).0 $(w).1)
SHOOT_KERNELS = $(foreach i,$(ISAS),$(foreach s,$(call SHOOT_SIZES,$(i)),$(i).$(s)))
ISA_OBJ   := $(ISAS:%=$(B)/src/sim/fast_kernel.%.o) \
             $(foreach k,$(SHOOT_KERNELS),$(B)/src/sim/shoot_kernel.$(k).o)

LIB_OBJ  := $(LIB_C:%.c=$(B)/%.o) $(LIB_CXX:%.cpp=$(B)/%.o) $(ISA_OBJ)
APP_OBJ  := $(APP_C:%.c=$(B)/%.o)
TEST_OBJ := $(TEST_C:%.c=$(B)/%.o) $(TEST_CXX:%.cpp=$(B)/%.o)
LIB      := $(B)/libmechkit.a
# The first number counts incompatible changes.
SO_VERSION := $(firstword $(subst ., ,$(VERSION)))
SO         := $(B)/libmechkit.so.$(VERSION)
SO_MAP     := src/libmechkit.map
APP      := $(B)/mechkit
TESTS    := $(B)/mechkit-tests

.PHONY: all
all: $(BUILD)/mechkit ## build build/mechkit (default)

$(BUILD)/mechkit: $(APP)
	@ln -sf $(VARIANT)/mechkit $@

$(LIB): $(LIB_OBJ)
	@rm -f $@
	$(call say,AR)$(AR) rcs $@ $^

$(SO): $(LIB_OBJ) $(SO_MAP)
	$(call say,LD)$(CXX) -shared $(OPT) -pthread -Wl,-soname,libmechkit.so.$(SO_VERSION) \
		-Wl,--version-script=$(SO_MAP) -Wl,-z,defs $(HARDEN_LD) $(LDFLAGS) -o $@ $(LIB_OBJ) $(LDLIBS_ALL)

.PHONY: libraries
libraries: $(LIB) $(SO) ## build the static and the shared library

$(B)/src/sim/sundials.o: CPPFLAGS_ALL += $(SUN_MPI_CFLAGS)
# Only the program has a screen; the library needs no curses.
$(B)/src/console/screen/tui_term.o: CPPFLAGS_ALL += $(TUI_CFLAGS)
APP_LIBS = $(TUI_LIBS) $(MPI_LIBS) $(LDLIBS_ALL)
ifeq ($(MPI),1)
MPI_LIBS := $(shell $(PKGCONFIG) --libs ompi-c)
$(B)/src/console/commands/sweep_mpi.o: CPPFLAGS_ALL += -DMK_HAVE_MPI $(shell $(PKGCONFIG) --cflags ompi-c | sed 's/-I/-isystem /g')
endif
$(APP): $(APP_OBJ) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(APP_LIBS)

CHECK_CFLAGS = $(shell $(PKGCONFIG) --cflags check 2>/dev/null)
CHECK_LIBS   = -Wl,--wrap=_mark_point $(shell $(PKGCONFIG) --libs check 2>/dev/null)

.PHONY: tests
# Programs cannot link a library with a sanitizer in it as users do; its tests are skipped there.
tests: $(TESTS) $(APP) $(if $(filter release debug,$(VARIANT)),$(SO))
$(TESTS): $(TEST_OBJ) $(filter-out %/main.o,$(APP_OBJ)) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(CHECK_LIBS) $(APP_LIBS)

# What is missing is said once, before the compiler says it in its own way.
.PHONY: have-libraries
have-libraries:
	@{ $(PKGCONFIG) --exists $(PKGS) && printf '#include <sundials/sundials_config.h>\n' | $(CC) -E - ; } \
		>/dev/null 2>&1 || { echo "mechkit: libraries that it is built with are missing: 'make deps' installs them" \
		"(Debian, Ubuntu) or names them" >&2; exit 1; }
$(LIB_OBJ) $(APP_OBJ) $(TEST_OBJ): | have-libraries

$(B)/%.o: %.c
	@mkdir -p $(@D)
	$(call say,CC)$(CC) $(CPPFLAGS_ALL) $(CFLAGS_ALL) -MMD -MP -c -o $@ $<
$(B)/%.o: %.cpp
	@mkdir -p $(@D)
	$(call say,CXX)$(CXX) $(PCH_FLAGS) $(CPPFLAGS_ALL) $(CXXFLAGS_ALL) -MMD -MP -c -o $@ $<

# Eigen and the standard library take a second of every C++ source's time; precompiled, a tenth. GCC
# takes the header itself where the precompiled one does not fit a source's flags. PCH=0 builds
# without, which is the default for other compilers and for ccache, which would have to be told.
ifneq ($(filter-out help clean deps,$(or $(MAKECMDGOALS),all)),)
PCH ?= $(shell case "$(CXX) $$(readlink -f "$$(command -v $(firstword $(CXX)))")" in (*ccache*) echo 0 ;; \
	(*) $(CXX) -dM -E -x c++ /dev/null 2>/dev/null | grep -q __clang__ && echo 0 || echo 1 ;; esac)
endif
ifeq ($(PCH),1)
PCH_HEADER := $(B)/precompiled.hpp
PCH_FLAGS  := -include $(PCH_HEADER)
# Expanded here: what single objects have besides must not get into it.
PCH_MAKE   := $(CXX) -x c++-header $(CPPFLAGS_ALL) $(CXXFLAGS_ALL)
$(LIB_CXX:%.cpp=$(B)/%.o) $(TEST_CXX:%.cpp=$(B)/%.o): $(PCH_HEADER).gch
# Its dependencies are those on the system's headers too: an upgrade makes it anew.
$(PCH_HEADER).gch: src/precompiled.hpp | have-libraries
	@mkdir -p $(@D)
	@cp $< $(PCH_HEADER)
	$(call say,PCH)$(PCH_MAKE) -MD -MP -MF $(PCH_HEADER).d -c -o $@ $(PCH_HEADER)
-include $(PCH_HEADER).d
endif
$(B)/src/sim/fast_kernel.%.o: $(ISA_SRC)
	@mkdir -p $(@D)
	$(call say,CXX)$(CXX) -x c++ $(CPPFLAGS_ALL) -DMK_ISA=$* $(CXXFLAGS_ALL) $(ISA_FLAGS_$*) -MMD -MP -c -o $@ $<
# $(1): instruction set, $(2): stretches side by side, $(3): with derivatives or without.
define SHOOT_RULE
$(B)/src/sim/shoot_kernel.$(1).$(2).$(3).o: $(SHOOT_SRC)
	@mkdir -p $$(@D)
	$$(call say,CXX)$(CXX) -x c++ $$(CPPFLAGS_ALL) -DMK_ISA=$(1)_$(2)_$(3) -DMK_WIDTH=$(2) -DMK_DERIVATIVES=$(3) \
		$$(CXXFLAGS_ALL) $(ISA_FLAGS_$(1)) $(SHOOT_OPT_$(1)) -MMD -MP -c -o $$@ $$<
endef
$(foreach k,$(SHOOT_KERNELS),$(eval $(call SHOOT_RULE,$(word 1,$(subst ., ,$(k))),$(word 2,$(subst ., ,$(k))),$(word 3,$(subst ., ,$(k))))))

# Check's macros convert freely; conversions are not errors in tests.
$(TEST_OBJ) $(B)/tests/challenge.o: CFLAGS_ALL += -Wno-conversion -Wno-pedantic
$(TEST_OBJ): CXXFLAGS_ALL += -Wno-conversion -Wno-pedantic -Wno-format-extra-args
$(B)/tests/challenge.o $(B)/tests/hidden_rig.o: CPPFLAGS_ALL += -Itests
$(TEST_OBJ): CPPFLAGS_ALL += -Itests $(CHECK_CFLAGS) -DMK_TEST_APP='"$(abspath $(APP))"' \
	-DMK_SOURCE_DIR='"$(CURDIR)"'

-include $(B)/tools/latency.d $(B)/tools/table31.d $(B)/tools/shots.d $(B)/tools/excitation.d $(B)/tools/roundtrip.d $(B)/tests/emu/plugged.d $(B)/tests/vm/vhci.d $(LIB_OBJ:.o=.d) $(APP_OBJ:.o=.d) $(TEST_OBJ:.o=.d) $(B)/tests/challenge.d $(B)/tests/hidden_rig.d

# demo and check build on all cores unless told how many (make -jN).
JOBS = $(if $(filter -j%,$(MAKEFLAGS)),,-j$(shell nproc 2>/dev/null || echo 1))

# --- targets ------------------------------------------------------------------------------------
.PHONY: deps
deps: ## install missing packages (Debian, Ubuntu), or name them
	@tools/deps.sh

.PHONY: check check-asan check-tsan
check: ## install what is missing, build, run the tests
	@tools/deps.sh
	@tools/floors.sh
	@$(MAKE) --no-print-directory $(JOBS) VARIANT=$(VARIANT) run-tests
.PHONY: check-all
check-all: ## check, with the few tests that take minutes each
	@MK_CHECK_ALL=1 $(MAKE) --no-print-directory check
check-asan: ## the tests under AddressSanitizer and UndefinedBehaviorSanitizer
	@$(MAKE) --no-print-directory $(JOBS) VARIANT=asan run-tests
check-tsan: ## the tests with threads under ThreadSanitizer
	@$(MAKE) --no-print-directory $(JOBS) VARIANT=tsan run-tests
.PHONY: run-tests
run-tests: tests
	@tools/run-tests.sh $(TESTS) $(VARIANT)

# Cases by the dozen take their time; the tests have a few of each.
.PHONY: challenge
TRUTH_OBJ := $(addprefix $(B)/tests/support/,truth.o truth_machine.o cases.o)
CHALLENGE_OBJ := $(B)/tests/challenge.o $(TRUTH_OBJ)
challenge: $(B)/mechkit-challenge $(APP) ## hide effects in made-up logs and score explain (CASES=200 SEED=1)
	@$< --cases $(or $(CASES),200) --seed $(or $(SEED),1) $(CHALLENGE_ARGS)
	@tools/challenge.py $(APP)
$(B)/mechkit-challenge: $(CHALLENGE_OBJ) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

.PHONY: rich
rich: $(APP) ## score explain on rigs with several effects at once
	@tools/rich.py $(APP)

# The same rigs behind a socket, and what investigate makes of them.
.PHONY: hidden-rigs
HIDDEN_RIG_OBJ := $(B)/tests/hidden_rig.o $(TRUTH_OBJ)
hidden-rigs: $(B)/mechkit-hidden-rig $(APP) ## investigate rigs that another simulator hides behind TCP (RIGS=40 SEED=1; takes an hour)
	@tools/hidden_rigs.py $(APP) $< --rigs $(or $(RIGS),40) --seed $(or $(SEED),1) $(HIDDEN_RIGS_ARGS)
$(B)/mechkit-hidden-rig: $(HIDDEN_RIG_OBJ) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

# Not part of check: what it measures is the machine.
SECONDS ?= 60
.PHONY: robustness
robustness: all ## catch and hold 200 rigs a setup that are off the model (SEEDS=200)
	@$(APP) robustness --seeds $(or $(SEEDS),200)

.PHONY: excitation
excitation: $(B)/excitation ## searched inputs beside a sine, by fits of many noisy logs each (takes minutes)
	@$<
$(B)/excitation: $(B)/tools/excitation.o $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

.PHONY: latency
latency: $(B)/latency ## lateness of samples at 1 kHz, beside cyclictest (SECONDS=60)
	@$(B)/latency $(SECONDS)
$(B)/latency: $(B)/tools/latency.o $(LIB)
	$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

.PHONY: handover
handover: $(B)/handover ## what the real-time thread pays for a row of the log, on a busy machine (SECONDS=60)
	@$(B)/handover $(SECONDS)
$(B)/handover: $(B)/tools/handover.o $(LIB)
	$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

# The program with a board plugged in that is not there: libusb's and the kernel's places are taken by
# stand-ins in tests/emu.
PLUGGED_OBJ := $(EMU_C:%.c=$(B)/%.o) $(B)/tests/emu/plugged.o
$(B)/mechkit-emulated: $(APP_OBJ) $(PLUGGED_OBJ) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(APP_LIBS)
$(B)/roundtrip: $(B)/tools/roundtrip.o $(PLUGGED_OBJ) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)
$(B)/tests/emu/plugged.o: CPPFLAGS_ALL += -Itests

.PHONY: demo-usb roundtrip fault-campaign
demo-usb: $(B)/mechkit-emulated ## swing up and balance through libusb, on an emulated board
	@tools/demo-usb.sh $< $(BUILD)/demo-usb
roundtrip: $(B)/roundtrip ## round trips through libusb at 1 kHz, emulated board (SECONDS=60)
	@$< $(SECONDS)
fault-campaign: tests ## every fault at every request of a run over each bus, with the figures
	@tools/fault-campaign.sh $(TESTS)

.PHONY: check-bare
check-bare: ## README's two commands on a bare Debian (RELEASE=trixie, AS=root; needs debootstrap and root)
	@tools/check-bare.sh $(BUILD)/bare $(or $(RELEASE),stable) $(or $(AS),root)

# The tests with the kernel's own bus under them: emu/usb.c and emu/udev.c make way for vm/vhci.c.
.PHONY: check-vm
VM_OBJ := $(filter-out %/emu/usb.o %/emu/udev.o,$(TEST_OBJ)) $(B)/tests/vm/vhci.o
check-vm: $(B)/mechkit-vm-tests ## the boards' tests on a real kernel, in a small virtual machine (needs qemu)
	@tools/check-vm.sh $< $(BUILD)/vm $(SUITES)
$(B)/mechkit-vm-tests: $(VM_OBJ) $(filter-out %/main.o,$(APP_OBJ)) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(CHECK_LIBS) $(APP_LIBS)
$(B)/tests/vm/vhci.o: CFLAGS_ALL += -Wno-conversion -Wno-pedantic
$(B)/tests/vm/vhci.o: CPPFLAGS_ALL += -Itests $(CHECK_CFLAGS)

# Hours of operation with everything that goes wrong; the last lines are the figures.
.PHONY: soak
SOAK_OBJ := $(patsubst %.c,$(B)/%.o,$(wildcard tools/soak/*.c))
soak: $(B)/soak ## endurance: random faults, gains, kills, full disks, clock steps (MINUTES=60 FIRST=1)
	@$< $(or $(MINUTES),60) $(or $(FIRST),1) $(BUILD)/soak-out
-include $(SOAK_OBJ:.o=.d)
$(B)/soak: $(SOAK_OBJ) $(filter-out %/main.o,$(APP_OBJ)) $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(APP_LIBS)

# Not part of check: it is a matter of time. `make monkey SECONDS=600 VARIANT=asan`.
.PHONY: monkey
monkey: tests ## random keys in the console, each halt looked at (SECONDS=60, VARIANT=asan or tsan)
	@MECHKIT_MONKEY_S=$(SECONDS) CK_RUN_SUITE=console_pty CK_RUN_CASE=chance \
		tools/run-tests.sh $(TESTS) $(VARIANT)

.PHONY: pictures
pictures: $(B)/shots $(APP) $(B)/mechkit-challenge ## render the pictures in docs/img from real runs
	@$< $(APP) docs/img
	@tools/swingup-picture.sh $(B)
	@tools/explain-picture.sh $(B)
	@tools/investigate-picture.sh $(B)
SHOTS_OBJ := $(B)/tools/shots.o $(B)/tests/support/pty.o $(B)/tests/support/vt.o
$(B)/tools/shots.o: CPPFLAGS_ALL += -Itests
$(B)/shots: $(SHOTS_OBJ)
	$(call say,LD)$(CC) $(OPT) $(HARDEN_LD) $(LDFLAGS) -o $@ $^

.PHONY: demo
demo: ## run every setup on the virtual board, explain a rig; a page of it all in build/demo
	@tools/deps.sh
	@mkdir -p $(BUILD)
	@echo "building (the first time this takes minutes) ..."
	@{ $(MAKE) --no-print-directory $(JOBS) all 2>&1; echo "exit $$?"; } | tools/build-progress.sh $(BUILD)/demo-build.log
	@rm -rf $(BUILD)/demo
	@tools/demo.sh $(BUILD)/demo $(BUILD)/mechkit

# Whatever comes in from outside, from any bytes whatever; needs clang. What reads it is built with the
# fuzzer's eyes in it, the rest is the library as it is.
.PHONY: fuzz
FUZZ_TARGETS := frame device wire log model cmdfile script json map table sweep journal
FUZZ_FLAGS := -O1 -g -fsanitize=fuzzer-no-link,address,undefined -fno-sanitize-recover=all
FUZZ_BOARD := $(addprefix src/driver/,frame.c device.c standalone.c standalone_laws.c)
FUZZ_FILES := $(wildcard src/base/*.c) src/base/number.cpp src/model/model_file.c \
              $(addprefix src/exchange/,import.c map.c read_mat.c scan_mat.c scan_apart.c read_text.c table.c unit.c) \
              $(addprefix src/exchange/,consistency.cpp plausible.cpp) src/driver/fault_script.c \
              $(addprefix src/console/script/,cmd.c cmd_after.c cmd_line.c cmd_params.c cmdfile.c condition.c) \
              $(addprefix src/experiment/,sweep_axis.c sweep_journal.c sweep_robustness.c) src/explain/sweep_explain.c \
              src/console/commands/sweep_spec.c \
              $(addprefix fuzz/,fuzz_file.c fuzz_mat.c fuzz_seen.c)
FUZZ_OBJ := $(FUZZ_FILES:%=$(BUILD)/fuzz/%.o)
FUZZ_CHOSEN := $(or $(TARGETS),$(FUZZ_TARGETS))
fuzz: $(FUZZ_CHOSEN:%=$(BUILD)/fuzz/%) ## libFuzzer on what is read from outside (SECONDS=60 each, TARGETS="frame device")
	@for t in $(FUZZ_CHOSEN); do \
		mkdir -p $(BUILD)/fuzz/corpus-$$t && echo "fuzzing $$t for $(SECONDS) s" && \
		$(BUILD)/fuzz/$$t -max_total_time=$(SECONDS) -verbosity=0 -print_final_stats=1 -timeout=20 \
			-artifact_prefix=$(BUILD)/fuzz/$$t- $(BUILD)/fuzz/corpus-$$t fuzz/corpus/$$t || exit 1; done
$(BUILD)/fuzz/frame $(BUILD)/fuzz/device: $(BUILD)/fuzz/%: fuzz/fuzz_%.c $(FUZZ_BOARD) $(wildcard src/driver/*.h)
	@mkdir -p $(@D)
	$(call say,FUZZ)$(CLANG) -std=c11 $(FUZZ_FLAGS) -fsanitize=fuzzer -Isrc -Iinclude -o $@ $< $(FUZZ_BOARD) -lm
# The host's side: with a clock, a libusb and a parallel port of the fuzzer's own.
FUZZ_HOST := $(addprefix src/driver/,board_parport.c board_usb.c frame.c parport.c usb.c usb_link.c wire.c) \
             src/base/status.c src/base/text.c $(addprefix fuzz/,wire_port.c wire_talk.c wire_usb.c)
FUZZ_INSTEAD := $(foreach f,clock_gettime nanosleep open close ioctl read write,-D$(f)=fuzz_$(f))
$(BUILD)/fuzz/wire: fuzz/fuzz_wire.c $(FUZZ_HOST) $(wildcard fuzz/*.h src/driver/*.h)
	@mkdir -p $(@D)
	$(call say,FUZZ)$(CLANG) -std=c11 $(FUZZ_FLAGS) -fsanitize=fuzzer $(FUZZ_INSTEAD) $(CPPFLAGS_ALL) -o $@ $< $(FUZZ_HOST) -lm
$(BUILD)/fuzz/%.c.o: %.c
	@mkdir -p $(@D)
	$(call say,FUZZ)$(CLANG) -std=c11 $(FUZZ_FLAGS) $(CPPFLAGS_ALL) -MMD -MP -c -o $@ $<
$(BUILD)/fuzz/%.cpp.o: %.cpp
	@mkdir -p $(@D)
	$(call say,FUZZ)$(CLANG)++ -std=c++17 $(FUZZ_FLAGS) $(CPPFLAGS_ALL) -MMD -MP -c -o $@ $<
$(BUILD)/fuzz/console.a: $(filter-out %/main.o,$(APP_OBJ))
	@mkdir -p $(@D)
	@rm -f $@
	$(call say,AR)$(AR) rcs $@ $^
$(BUILD)/fuzz/%: $(BUILD)/fuzz/fuzz/fuzz_%.c.o $(FUZZ_OBJ) $(BUILD)/fuzz/console.a $(LIB)
	$(call say,FUZZ)$(CLANG)++ $(FUZZ_FLAGS) -fsanitize=fuzzer -pthread -o $@ $^ $(APP_LIBS)
.SECONDARY: $(FUZZ_OBJ)
-include $(FUZZ_OBJ:.o=.d)

.PHONY: table31
table31: $(B)/table31 ## the report's table 3.1 again, errors and coverage of every method (DRAWS=200)
	@$(B)/table31 $(or $(DRAWS),200)
$(B)/table31: $(B)/tools/table31.o $(LIB)
	$(call say,LD)$(CXX) $(OPT) -pthread $(HARDEN_LD) $(LDFLAGS) -o $@ $^ $(LDLIBS_ALL)

# Logs in $$MECHKIT_SHARED or ../shared; skipped without.
.PHONY: intervals measured
intervals: $(APP) ## how often 95 % intervals hold the true parameters, on made-up logs with answers
	@tools/intervals.py $<
measured: $(APP) ## fits of rigs that others measured beside their published parameters (takes minutes)
	@tools/measured.py $< build/measured.json

.PHONY: measured-splits
measured-splits: $(APP) ## the same rigs, learnt from halves of the logs, other logs, and with the roles exchanged
	@tools/splits.py $<

.PHONY: install install-strip uninstall
# Without debug information, which is four fifths of it; INSTALL_DEBUG=1 keeps it (packages split it off).
install: $(LIB) $(SO) $(APP) ## install under PREFIX (default /usr/local), staged under DESTDIR
	install -d $(DESTDIR)$(BINDIR) $(DESTDIR)$(LIBDIR)/pkgconfig $(DESTDIR)$(MANDIR)/man1 \
		$(DESTDIR)$(INCLUDEDIR)/mechkit $(DESTDIR)$(DATADIR)/mechkit/models/measured \
		$(DESTDIR)$(DATADIR)/mechkit/scripts $(DESTDIR)$(DATADIR)/mechkit/tools $(DESTDIR)$(DATADIR)/mechkit/matlab \
		$(DESTDIR)$(DATADIR)/doc/mechkit/examples
	install -m 755 $(APP) $(DESTDIR)$(BINDIR)/mechkit
	install -m 644 $(LIB) $(DESTDIR)$(LIBDIR)/libmechkit.a
	install -m 644 $(SO) $(DESTDIR)$(LIBDIR)
	ln -sf $(notdir $(SO)) $(DESTDIR)$(LIBDIR)/libmechkit.so.$(SO_VERSION)
	ln -sf libmechkit.so.$(SO_VERSION) $(DESTDIR)$(LIBDIR)/libmechkit.so
	install -m 644 include/mechkit/*.h $(DESTDIR)$(INCLUDEDIR)/mechkit
	tools/man-pages.sh $(APP) $(DESTDIR)$(MANDIR)/man1
	install -d $(DESTDIR)$(DATADIR)/bash-completion/completions
	install -m 644 tools/mechkit.bash $(DESTDIR)$(DATADIR)/bash-completion/completions/mechkit
	install -m 644 models/*.ini models/*-swingup.csv $(DESTDIR)$(DATADIR)/mechkit/models
	install -m 644 models/measured/*.ini models/measured/*.map $(DESTDIR)$(DATADIR)/mechkit/models/measured
	install -m 755 tools/demo.sh $(DESTDIR)$(DATADIR)/mechkit/tools
	install -m 644 scripts/*.cmd scripts/*.ini $(DESTDIR)$(DATADIR)/mechkit/scripts
	install -m 644 tools/matlab_export/*.m $(DESTDIR)$(DATADIR)/mechkit/matlab
	install -m 644 README.md LICENSE docs/*.md $(DESTDIR)$(DATADIR)/doc/mechkit
	install -m 644 examples/*.c $(DESTDIR)$(DATADIR)/doc/mechkit/examples
	install -d $(DESTDIR)$(PREFIX)/lib/udev/rules.d
	install -m 644 udev/70-mechkit.rules $(DESTDIR)$(PREFIX)/lib/udev/rules.d
	install -d $(DESTDIR)$(SYSCONFDIR)/security/limits.d
	install -m 644 udev/mechkit-limits.conf $(DESTDIR)$(SYSCONFDIR)/security/limits.d/mechkit.conf
	sed -e 's|@PREFIX@|$(PREFIX)|' -e 's|@LIBDIR@|$(LIBDIR)|' -e 's|@INCLUDEDIR@|$(INCLUDEDIR)|' \
		-e 's|@VERSION@|$(VERSION)|' -e 's|@PRIVATE_LIBS@|$(SUN_LIBS) $(PKG_LIBS)|' mechkit.pc.in >$(DESTDIR)$(LIBDIR)/pkgconfig/mechkit.pc
ifneq ($(INSTALL_DEBUG),1)
	$(STRIP) --strip-unneeded $(DESTDIR)$(BINDIR)/mechkit $(DESTDIR)$(LIBDIR)/$(notdir $(SO))
	$(STRIP) --strip-debug $(DESTDIR)$(LIBDIR)/libmechkit.a
endif
install-strip: install
uninstall: ## remove what install put there
	rm -rf $(DESTDIR)$(BINDIR)/mechkit $(DESTDIR)$(LIBDIR)/libmechkit.a \
		$(DESTDIR)$(LIBDIR)/libmechkit.so* $(DESTDIR)$(LIBDIR)/pkgconfig/mechkit.pc $(DESTDIR)$(MANDIR)/man1/mechkit*.1 \
		$(DESTDIR)$(DATADIR)/bash-completion/completions/mechkit \
		$(DESTDIR)$(INCLUDEDIR)/mechkit $(DESTDIR)$(DATADIR)/mechkit $(DESTDIR)$(DATADIR)/doc/mechkit \
		$(DESTDIR)$(PREFIX)/lib/udev/rules.d/70-mechkit.rules \
		$(DESTDIR)$(SYSCONFDIR)/security/limits.d/mechkit.conf

.PHONY: fmpy
fmpy: ## FMPy in a virtual environment under build/, for the tests of FMUs (from the network)
	$(PYTHON) -m venv $(BUILD)/fmpy
	$(BUILD)/fmpy/bin/pip install --quiet fmpy

.PHONY: html
html: all ## documentation as web pages in build/html, with plots made on the way (needs pandoc, gnuplot)
	@tools/html/build.sh $(APP) $(BUILD)/html

.PHONY: deb
deb: ## Debian packages of program, library and headers in build/deb, looked at by lintian
	@tools/deb.sh $(BUILD)

.PHONY: bench
BENCH_SRC := $(addprefix tools/bench/,bench_sim.cpp bench_work.cpp bench_identify.cpp bench_explain.cpp)
bench: $(B)/libmkbench.so $(B)/latency $(B)/handover $(B)/roundtrip $(B)/mechkit-challenge ## speed beside others', to build/bench.json (SECTIONS="logs ...")
	$(PYTHON) -B tools/bench/bench.py $(BUILD) $(abspath $<) $(SECTIONS)
$(B)/libmkbench.so: $(BENCH_SRC) $(LIB) tools/bench/bench_pendubot.hpp
	$(call say,LD)$(CXX) -shared $(CPPFLAGS_ALL) $(CXXFLAGS_ALL) $(HARDEN_LD) $(LDFLAGS) -o $@ $(BENCH_SRC) $(LIB) $(LDLIBS_ALL)

.PHONY: cov
cov: ## lines and branches that the tests reach, by folder (needs gcovr)
	@$(MAKE) --no-print-directory $(JOBS) VARIANT=cov tests
	@tools/coverage.sh $(BUILD)/cov

.PHONY: mutants
MUTATED ?= $(wildcard src/driver/*.c) src/ctrl/safety.c src/ctrl/residual.c src/ctrl/board_watch.c \
	$(wildcard src/ctrl/loop*.c) src/base/out_file.c src/base/temporary.c \
	$(wildcard src/base/log_write*.c)
MUTANTS ?= 60
mutants: all tests ## changes one thing at a time in the code of the safety chain: does a test notice?
	$(PYTHON) tools/mutate.py --sample $(MUTANTS) $(MUTATED)

.PHONY: format format-check
FORMAT_FILES := $(shell find include src tests tools fuzz examples -name '*.[ch]' -o -name '*.cpp' -o -name '*.hpp' -o -name '*.cc' 2>/dev/null)
format: ## format all sources
	$(CLANG_FORMAT) -i $(FORMAT_FILES)
format-check: ## fail when a source is not formatted
	$(CLANG_FORMAT) --dry-run -Werror $(FORMAT_FILES)

.PHONY: floors
floors: ## fail when a folder includes one it must not know, or files of one need each other
	@tools/floors.sh
	@$(MAKE) --no-print-directory $(JOBS) VARIANT=$(VARIANT) $(APP)
	@tools/circles.sh $(B)

.PHONY: tidy
tidy: ## clang-tidy over all sources
	$(CLANG_TIDY) --quiet $(LIB_C) $(APP_C) -- -std=c11 $(CPPFLAGS_ALL)
	$(CLANG_TIDY) --quiet $(LIB_CXX) -- -std=c++17 $(CPPFLAGS_ALL)

.PHONY: clean
clean: ## remove build/
	rm -rf $(BUILD)

.PHONY: help
help: ## this list
	@awk -F':.*## ' '/^[a-z0-9-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
