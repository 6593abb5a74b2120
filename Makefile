# SPDX-License-Identifier: Apache-2.0
# `make` alone says what there is.

SHELL := /bin/bash
PYTHON3 := $(or $(PYTHON),python3)

.PHONY: setup
setup: ## set up what is missing
	@$(PYTHON3) ros2_ws/bootstrap.py
