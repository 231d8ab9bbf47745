"""Finished runs on public benchmarks, and on their stand-ins → the page docs/benchmarks.md."""
