// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// Names for the landmarks that the theme leaves without one: a screen reader lists them.

const NAMES = { ".sidebar-drawer": "All pages", ".toc-drawer": "On this page" };
for (const [landmark, name] of Object.entries(NAMES)) document.querySelector(landmark)?.setAttribute("aria-label", name);
