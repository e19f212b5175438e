// What a person can mend, said in one sentence.

export class InputError extends Error {}
