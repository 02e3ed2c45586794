// Number formats with the decimal sign of the page's language.

export const number = (value, digits, language) =>
  value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });

// Mass of the load. Not shown below the detection limit, nor if negative: the worker then leans on something and the plate
// measures less than the body weight.
export const load = (massKg, language) => (massKg > 0 ? `${number(massKg, 1, language)} kg` : "–");
