// Everything that the reference shows, and every script it runs, comes from the service itself.
const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => document.documentElement.classList.toggle("dark-mode", dark.matches);
dark.addEventListener("change", follow);
follow();
SwaggerUIBundle({ dom_id: "#reference", url: "/openapi.json", deepLinking: true, docExpansion: "none", defaultModelsExpandDepth: -1, validatorUrl: null });
