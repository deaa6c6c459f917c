/** An RFC 9457 problem document: what went wrong, and at which place of the request. */
export interface ProblemDocument {
  type?: string;
  title: string;
  status: number;
  detail: string;
  errors?: { pointer: string; detail: string }[];
}

export class Problem extends Error {
  readonly document: ProblemDocument;

  constructor(document: ProblemDocument) {
    super(document.detail || document.title);
    this.document = document;
  }

  static of(body: unknown, status: number): Problem {
    if (typeof body === "object" && body !== null && "detail" in body) return new Problem(body as ProblemDocument);
    return new Problem({ status, title: `HTTP ${status}`, detail: typeof body === "string" && body ? body.slice(0, 300) : `HTTP ${status}` });
  }

  get status(): number {
    return this.document.status;
  }

  /** The sentence that belongs to a place of the request, or to something inside it. */
  at(pointer: string): string | undefined {
    return this.document.errors?.find((fault) => fault.pointer === pointer || fault.pointer.startsWith(`${pointer}/`))?.detail;
  }

  /** What belongs to none of the places that a form shows. */
  elsewhere(shown: readonly string[]): string[] {
    const faults = this.document.errors ?? [];
    if (faults.length === 0) return [this.document.detail];
    return faults.filter((fault) => !shown.some((p) => fault.pointer === p || fault.pointer.startsWith(`${p}/`))).map((fault) => (fault.pointer ? `${fault.pointer}: ${fault.detail}` : fault.detail));
  }
}

export function isProblem(error: unknown, status?: number): error is Problem {
  return error instanceof Problem && (status === undefined || error.status === status);
}
