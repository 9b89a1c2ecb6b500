"""Style of the HTML report: follows the reader's light or dark theme and the width of the window; no network, no script."""

STYLE = """
:root { color-scheme: light dark; --ground: #ffffff; --ink: #1d2a24; --soft: #5d6b64; --line: #dfe5e1; --tint: #f4f7f5; --leaf: #2d7a53;
  --other: #b9c6be; --warn: #a33; }
@media (prefers-color-scheme: dark) { :root { --ground: #141816; --ink: #e3eae6; --soft: #9aaaa1; --line: #2e3833; --tint: #1c2320;
  --leaf: #63bd8d; --other: #4a5a51; --warn: #ef8a80; } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; background: var(--ground); color: var(--ink); margin: 0 auto; max-width: 1180px;
  padding: 32px 24px 80px; overflow-wrap: anywhere; }
h1 { font-size: 28px; line-height: 1.2; margin: 0 0 6px; } h2 { font-size: 19px; margin: 44px 0 10px; } h3 { font-size: 15px; margin: 18px 0 6px; }
p, li { max-width: 92ch; } p { margin: 0 0 8px; } .soft { color: var(--soft); } .warn { color: var(--warn); font-weight: 600; }
nav { margin: 10px 0 0; } nav a { margin-right: 14px; white-space: nowrap; } a, summary { color: var(--leaf); } summary { cursor: pointer; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(320px, 100%), 1fr)); gap: 14px; margin: 18px 0; }
.card { border: 1px solid var(--line); border-radius: 8px; padding: 14px 16px; }
.card h3 { margin: 0; } .card p { font-size: 13px; margin: 2px 0 10px; }
.card .value { font-size: 30px; line-height: 1.2; font-weight: 600; font-variant-numeric: tabular-nums; color: var(--leaf); }
.card .value small { font-size: 12px; font-weight: 400; color: var(--soft); margin-left: 6px; white-space: nowrap; }
.bars { display: grid; grid-template-columns: minmax(0, 11em) 1fr 3.2em; gap: 3px 8px; align-items: center; font-size: 12px; }
.bars b, .bars span { line-height: 1.3; } .bars i { display: block; height: 9px; border-radius: 2px; background: var(--other); }
.bars i.own { background: var(--leaf); } .bars u { text-decoration: none; text-align: right; font-variant-numeric: tabular-nums; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; overflow-wrap: normal; }
th, td { text-align: left; padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--soft); font-weight: 600; background: var(--tint); } td:last-child { overflow-wrap: break-word; }
td:first-child, th:first-child { padding-left: 6px; position: sticky; left: 0; background: var(--ground); } th:first-child { background: var(--tint); }
.case { margin: 0 0 12px; max-width: 800px; } .case img { display: block; width: 100%; border: 1px solid var(--line); }
.case figcaption { font-size: 12px; color: var(--soft); }
.heads { display: grid; grid-template-columns: repeat(5, 1fr); max-width: 800px; font-size: 12px; color: var(--soft); }
.key i { display: inline-block; width: 11px; height: 11px; margin: 0 4px 0 12px; }
details { margin: 12px 0; } pre { font-size: 12px; overflow-x: auto; background: var(--tint); padding: 12px; overflow-wrap: normal; }
"""
