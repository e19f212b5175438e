const chosen = ["network", "class", "right"].map((name) => document.getElementById(`by-${name}`));
const cards = [...document.querySelectorAll("#cards > article")];
function show() {
  const [network, label, right] = chosen.map((select) => select.value);
  let count = 0;
  for (const { dataset, ...rest } of cards.map((card) => ({ card, dataset: card.dataset }))) {
    const fits =
      (!network || dataset.network === network) &&
      (!label || dataset.label === label || dataset.predicted === label) &&
      (!right || dataset.right.split(" ").includes(right));
    rest.card.hidden = !fits;
    count += fits;
  }
  document.getElementById("count").textContent = count;
}
if (chosen[0]) {
  for (const select of chosen) select.addEventListener("change", show);
  show();  // a reloaded page keeps what was chosen
}
