/** Send a command to the page's server; return the answer. An error has the `status` of a refusal. */
export async function post(command, query = location.search) {
  const response = await fetch(`command${query}`, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(command),
  });
  const answer = await response.json();
  if (!response.ok) throw Object.assign(new Error(answer.error), { status: response.status });
  return answer;
}
