// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "web_driver.hpp"

// What every page of Telefab keeps to, whatever it shows.
namespace telefab::test {

/// Texts with too little contrast, each with its ratio: WCAG 2.1, 1.4.3, 4.5 to 1 of every text that shows, against the
/// first opaque ground behind it. Words of controls that are off are exempt there.
inline std::string texts_without_contrast(Browser& browser) {
  return browser
      .run(R"(
    const light = (c) => c.map((v) => v / 255).map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
      .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const parts = (text) => (text.match(/[\d.]+/g) || []).map(Number);
    const ground = (e) => { for (; e; e = e.parentElement) { const c = parts(getComputedStyle(e).backgroundColor);
      if (c.length === 3 || c[3] === 1) return c.slice(0, 3); } return [255, 255, 255]; };
    const ratio = (e) => { const a = light(parts(getComputedStyle(e).color).slice(0, 3)), b = light(ground(e));
      return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05); };
    return [...document.querySelectorAll('body *')].filter((e) => e.offsetParent && !e.disabled &&
      (e.matches('select, input:not([type=range], [type=checkbox], [type=radio])') || [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())))
      .filter((e) => ratio(e) < 4.5).map((e) => `${ratio(e).toFixed(2)} ${e.outerHTML.slice(0, 80)}`);)")
      .dump(1);
}

/// Controls and pictures that a screen reader has no name for, roles that it knows nothing of, names of other elements
/// that are not there, and headings that leave out a level.
inline std::string faults_for_screen_readers(Browser& browser) {
  return browser
      .run(R"(
    const shows = (e) => e.checkVisibility ? e.checkVisibility() : e.offsetParent;
    const faults = [], all = [...document.querySelectorAll('body *')].filter(shows);
    for (const e of all.filter((e) => e.matches('button, input, select, textarea, canvas, img, progress, summary, [role=img]')))
      if (!(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.hasAttribute('alt') || e.labels?.length ||
            e.title || (e.matches('button, summary') && e.textContent.trim()))) faults.push(`no name: ${e.outerHTML.slice(0, 80)}`);
    for (const e of document.querySelectorAll('[aria-labelledby], [aria-describedby], label[for], output[for]'))
      for (const name of ['aria-labelledby', 'aria-describedby', 'for'])
        for (const id of (e.getAttribute(name) || '').split(/\s+/).filter(Boolean))
          if (!document.getElementById(id)) faults.push(`${name} of nothing: ${id}`);
    const ids = [...document.querySelectorAll('[id]')].map((e) => e.id);
    for (const id of new Set(ids)) if (ids.filter((each) => each === id).length > 1) faults.push(`twice: ${id}`);
    let level = 0;
    for (const h of all.filter((e) => e.matches('h1, h2, h3, h4, h5'))) {
      const here = Number(h.tagName[1]);
      if (here > level + 1) faults.push(`h${here} under h${level}: ${h.textContent}`);
      level = here;
    }
    if (!document.documentElement.lang) faults.push('no language');
    if (!document.querySelector('main')) faults.push('no main');
    return faults;)")
      .dump(1);
}

/// Controls that the Tab key does not come to.
inline std::string out_of_reach_of_tab(Browser& browser) {
  const std::string reachable = R"([...document.querySelectorAll('a[href], button, input, select, summary, [tabindex]')]
    .filter((e) => (e.checkVisibility ? e.checkVisibility() : e.offsetParent) && !e.disabled && e.tabIndex >= 0 &&
      !(e.type === 'radio' && !e.checked)))";
  browser.run(
      "window.reached = new Set(); document.addEventListener('focusin', (e) => reached.add(e.target)); "
      "document.activeElement?.blur(); window.getSelection().removeAllRanges(); return true;");
  const auto count = browser.run("return " + reachable + ".length;").get<int>();
  for (int presses = 0; presses < count + 5; ++presses) browser.press({"\uE004"});
  return browser.run("return " + reachable + ".filter((e) => !reached.has(e)).map((e) => e.outerHTML.slice(0, 80));")
      .dump(1);
}

}  // namespace telefab::test
