import { useQuery, useQueryClient } from "@tanstack/react-query";
import { api, must, setCsrfToken } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";

export interface Visitor {
  name: string;
  workspace: string;
  scopes: string[];
}

const KEY = ["session"];

/** Who is signed in; null when nobody is. */
export function useVisitor() {
  return useQuery<Visitor | null>({
    queryKey: KEY,
    staleTime: Infinity,
    retry: false,
    queryFn: async () => {
      try {
        const found = await must(api.GET("/v1/session"));
        setCsrfToken(found.csrf_token);
        return found;
      } catch (error) {
        if (isProblem(error, 401)) return null;
        throw error;
      }
    },
  });
}

export function useSigning() {
  const queries = useQueryClient();
  return {
    /** Sends the key once; what opens the doors from now on is a cookie that no script can read. */
    async signIn(key: string): Promise<void> {
      const found = await must(api.POST("/v1/session", { headers: { Authorization: `Bearer ${key.trim()}` } }));
      setCsrfToken(found.csrf_token);
      queries.setQueryData(KEY, found);
    },
    async signOut(): Promise<void> {
      await must(api.DELETE("/v1/session"));
      setCsrfToken(null);
      queries.setQueryData(KEY, null);
      queries.removeQueries({ predicate: (query) => query.queryKey[0] !== KEY[0] });
    },
  };
}
