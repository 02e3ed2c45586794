// Numbers for people: with the decimal sign of the language in which they are told.

export const number = (value, digits, language) =>
  value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });

// What is in the hands. Too little to be judged is not nothing; and who leans on something carries nothing: the plate then
// bears less than the body.
export const load = (massKg, language) => (massKg > 0 ? `${number(massKg, 1, language)} kg` : "–");
