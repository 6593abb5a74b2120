// Copyright 2026 ATPID maintainers
// SPDX-License-Identifier: Apache-2.0
// The order of the search's results (Sphinx: html_search_scorer). The values are Sphinx's own; `score` puts what
// measures and explains the project behind all pages that say how to use it.

const LAST = /^docs\/(research|decisions|changes)|(CHANGELOG|QUALITY_DECLARATION)$/;

var Scorer = {
  score: ([page, _title, _anchor, _description, score]) => (LAST.test(page) ? score - 1000 : score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
